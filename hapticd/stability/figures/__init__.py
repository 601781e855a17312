"""Figures of the theory, a file a subject; each is given what was found, and computes nothing."""
