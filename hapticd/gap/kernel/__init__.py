"""Compiled code of the gap workflow: the filter, and the linear recursions along its path."""
