"""Hardware in the loop: the real daemon against simulated hardware in a process of its own, as a user would run it.

``hapticd hil`` starts the device, starts the daemon on it, plays the Fig. 8 releases and an excitation, and compares what
the encoder saw with ``simulate``; the delay from sample to current is read out of the device's own log. The fault matrix
injects one fault after another and reads from that same log when the current really was zero.
"""
