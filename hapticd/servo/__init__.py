"""The tick: clock, render, safety gate, timing, ring, mailbox."""
