"""hapticd: a real-time 1-DOF haptic controller daemon that carries the science of stable haptic rendering."""
