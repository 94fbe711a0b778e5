"""From touches to parameters, their uncertainty, and what they change."""
