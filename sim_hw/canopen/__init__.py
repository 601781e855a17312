"""A simulated CANopen servo drive: CiA 301 communication, CiA 402 torque modes, and the Copley objects that hapticd uses.

``layout`` is its memory, ``dictionary`` and ``drive.eds`` its objects. Compiled: ``states``, ``power``, ``drive`` (CiA 402),
``pdo``, ``node``, ``sending``, ``receiving`` (CiA 301), ``timeline`` (what is due), ``serve`` (the loop). In Python:
``sdo``, ``mapping``, ``device``, ``transport``, ``command``.
"""
