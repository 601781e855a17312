"""The servo loop: clock, rendering, safety gate, timing statistics, ring, mailbox."""
