"""Robots to export, none of whose parameters is nominal, and what every format must give back of them."""

import numpy as np
from identified import identified
from oracle import forward

from identify.model.cell import Cell
from identify.model.urdf.chain import read_urdf

MICRO = 1e-6  # [mm]
ROBOTS = ("arc-welder", "irb120", "puma560", "arm7", "scara")


def cell_of(robot):
    return Cell(robot, None, np.array([340.0, 740, 350, -1.5, 0.1, 0.05]), np.array([5.0, -3, 410, 0.2, -0.3, 0.1]))


def wrong(cell, rng):
    """A calibration of a robot none of whose parameters is nominal."""
    spread = np.where(cell.robot.angular, np.radians(0.5), 2.0)
    return identified(cell, cell.theta + spread * rng.standard_normal(len(cell.theta)))


def draws(robot, rng, count=20):
    return rng.uniform(robot.lower, robot.upper, (count, len(robot.joints)))


def assert_same(found, calibration, rng, tolerance=MICRO):
    """The identified forward kinematics, by the oracle, at joint values drawn within the limits."""
    robot = calibration.cell.robot
    for q in draws(robot, rng):
        T = forward(robot, q, calibration.theta)
        assert np.abs(found(q)[:3, 3] - T[:3, 3]).max() < tolerance
        assert np.abs(found(q)[:3, :3] - T[:3, :3]).max() < 1e-9


URDF = """<?xml version="1.0"?>
<!-- an arm with <origin xyz="9 9 9"/> in a comment -->
<robot name="arm" xmlns:xacro="x">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="world"/>
  <joint name="stand" type="fixed"><parent link="world"/><child link="base_link"/><origin xyz="0 0 1"/></joint>
  <link name="base_link">
    <visual><origin xyz="0 0 0.1" rpy="0 0 0"/><geometry><mesh filename="b.stl"/></geometry></visual></link>
  <joint name='a 1' type='revolute' >
    <origin rpy='0 0 0'
            xyz = '0 0 0.29'   />
    <parent link="base_link"/><child link="l1"/>
    <axis xyz="0 0 -1"/><limit lower="-2.8" upper="2.8" velocity="2" effort="10"/>
    <dynamics damping="0.1"/>
  </joint>
  <link name="l1"/>
  <joint name="a2" type="revolute"><parent link="l1"/><child link="l2"/>
    <axis xyz="0 1 0"/><limit lower="-1.9" upper="1.9" velocity="2" effort="10"/></joint>
  <link name="l2"/>
  <joint name="spacer" type="fixed"><parent link="l2"/><child link="l2b"/>
    <origin xyz="0 0.02 0.1" rpy="0.1 0 0.2"/></joint>
  <link name="l2b"/>
  <joint name="a3" type="prismatic"><origin xyz="0.01 0 0.27"/><parent link="l2b"/><child link="l3"/>
    <axis xyz="1 0 1"/><limit lower="0" upper="0.4" velocity="0.5" effort="10"/></joint>
  <link name="l3"/>
  <joint name="a4" type="revolute"><origin xyz="0.3 0 0" rpy="0 1.5 0"/><parent link="l3"/><child link="l4"/>
    <axis xyz="0 0.6 0.8"/><limit lower="-2" upper="2" velocity="2" effort="10"/></joint>
  <link name="l4"/>%s
</robot>
"""
FLANGE = """
  <joint name="f" type="fixed"><origin xyz="0.07 0 0"/><parent link="l4"/><child link="flange"/></joint>
  <link name="flange"/>
  <joint name="t" type="fixed"><origin rpy="0 1 0"/><parent link="flange"/><child link="tool0"/></joint>
  <link name="tool0"/>"""


def from_urdf(folder, tail, base, flange, rng):
    """A URDF on disk, and a calibration of the robot that it describes."""
    path = folder / "arm.urdf"
    path.write_text(URDF % tail)
    return path, wrong(cell_of(read_urdf(path, base, flange)), rng)
