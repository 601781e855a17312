"""The gap workflow on measured data: the EMPS axis and a cogging motor, against published and independent figures."""
