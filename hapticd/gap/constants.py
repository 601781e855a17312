"""Every constant of the verdict, each with its reason."""

BLOCK_S = 1.0
"""Length of the blocks over which scores are taken as independent [s]: several correlation times of what machines do."""
FEWEST_BLOCKS = 20
"""A short recording has shorter blocks, so that each fold of five still has four."""
FOLDS = 5
"""Parameters that judge a block are estimated without its fold: a fifth of the data."""
HELD_BACK = 0.01
"""Share of all data's information on a parameter below which what the other folds say of it is not followed: near a
breakaway, or at an impact, one block may know nearly all."""
SHORT_MEMORY_S = 0.05
"""Largest correlation time of the disturbance torque while effects are searched [s]: a slower one takes the place of
friction and of slow effects as long as they are not in the model (docs/explanation/gap-statistics.md)."""
MEMORIES = 60.0
"""Correlation times that the recordings hold at least when the answer is judged: a slower disturbance is a slow effect."""
LEAST_WHITE = 1e-3
"""Share of the torque that is white noise from tick to tick at least: no machine's torque is more reproducible."""
WINDOW_S = 0.05
"""Duration over which the noise floor of the missing force is stated [s]."""
LASTING_S = 0.02
"""Time over which a white force is averaged to count as missing [s]: what is faster than 50 Hz moves no shaft."""
LEVEL = 0.005
"""Probability that nothing missing is given a name, over the whole catalogue."""
SHARE = 0.07
"""Share of what is still missing, in power, that an effect must close to be named."""
CLOSED = 0.5
"""Share of the missing force's power that a law must close with a slow disturbance, where it is not sure."""
EXPLAINED = 0.7
"""Share of the missing force's power that the named effects must close to be all that was found to be missing."""
DRIVE_KEPT = 0.3
"""Share of the driving torque, and of the moving samples, that a law must leave: what cancels the drive fits anything."""
STRUCTURE_SHARE = 0.03
"""Share of the power of what is still missing that a function of one coordinate must explain to be a structure."""
MATTERS = 0.001
"""Share of the power that was missing before, beyond which a structure that is left matters: 3 % of the force."""
LOUD = 0.3
"""Share of what friction and current make, beyond which a force that is missing without a structure is not nothing."""
BASE_PRIOR = 1.5
"""Standard deviation of the logarithm of a base parameter that is fitted along: a factor of 4.5."""
QUIET = 2.0
"""Times what the least noise makes that any device has, or the noise floor, below which a missing force is none."""
MOVES = 0.5
"""Share of what viscous friction leaves of a velocity that must outlast a period: less is a shaft that Coulomb friction
holds, and no force shows on it."""
ORDER_GAIN = 10.0
"""Least expected gain of an order of a ripple [nats]: the best of ninety does by chance in one run of two hundred."""
ORDER_SHARE = 0.02
"""Share of the joint gain of all orders of a ripple that a further one must add: the rest is any function of position."""
GRIP_BLOCKS = 2
"""Blocks that a grip lasts at least, so that the score of one is held out with another to tell of the hand."""
LINE = 25.0
"""Power over that of the neighbourhood at which a frequency is a line in time: by chance hardly one ever does."""
IMITATIONS = 5
"""Recordings that a model makes itself, to see how far an estimate goes: all their blocks are a hundred and more."""
INDISTINGUISHABLE = 3.0
"""Standard errors of evidence up to which two laws are indistinguishable."""
MOST_EFFECTS = 4
"""Most effects that are searched."""
