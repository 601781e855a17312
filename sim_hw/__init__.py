"""Simulated hardware in processes of its own, speaking the real protocols over interfaces of the operating system.

``python -m sim_hw serial`` is the serial DAC board of ``docs/protocols/serial-dac.md`` on a pseudo-terminal. A device moves
the exact plant of :mod:`hapticd.plant` in real time, keeps its own log of what really happened, and can be made to fail by
a script. It shares no protocol code with the drivers: what one end gets wrong, the other must not get wrong alike.
"""
