"""Simulated hardware in processes of its own, speaking the real protocols. The drivers it answers to come next."""
