"""Simulated hardware in separate processes, with the real protocols on interfaces of the operating system.

``python -m sim_hw serial`` is the serial DAC board of ``docs/protocols/serial-dac.md`` on a pseudo-terminal. A device moves
the exact plant of :mod:`hapticd.plant` in real time, logs the true state, and can fail by
a script. It shares no protocol code with the drivers, so that both ends cannot have the same error.
"""
