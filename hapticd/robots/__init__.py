"""Recordings of robots: one joint of many, out of a bag of ROS messages; and what a URDF says of it."""

from __future__ import annotations

from hapticd.robots._bag import import_bag, is_bag
from hapticd.robots._urdf import hold_against, limits_of

__all__ = ["hold_against", "import_bag", "is_bag", "limits_of"]
