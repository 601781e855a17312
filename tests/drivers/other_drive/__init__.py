"""A CiA 402 torque drive of other hands: durand's CANopen responder, a state machine out of the standard's diagram, a plant
of a few lines.

Written from CiA 301, CiA 402-2 and Copley's published objects alone. It imports nothing of `drivers` and `sim_hw`, so that a
misreading which those two share shows here. It takes the scripts of docs/reference/simulated-hardware.md, and writes a log
with their columns, so that one list of tests runs against both.
"""
