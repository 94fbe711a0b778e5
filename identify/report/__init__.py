"""Pictures and pages: one self-contained HTML file of a calibration or a plan.

In the order in which data walks through:

    svg     charts as inline SVG
    scene   jig, zone, touches and robot as plain data for the 3-D view
    charts  the numbers of a calibration as charts
    findings  joint errors that the touches chose, and causes that residuals show
    ladder  what each way of applying the calibration gives
    page    one self-contained page, its tables and its 3-D view
    certificate  head and foot of a report: who, when, with what, and lines to sign
    history  what has changed since earlier calibrations
    report  the report of a calibration
    plan    the page of a plan
    cell    the page of a cell, before any touch
"""
