"""Recordings of robots: one joint of many, out of a bag of ROS messages."""

from __future__ import annotations

from hapticd.robots.bag import import_bag, is_bag

__all__ = ["import_bag", "is_bag"]
