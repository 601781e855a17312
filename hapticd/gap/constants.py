"""Every constant of the verdict, each with its reason."""

BLOCK_S = 1.0
"""Length of the blocks that count as independent [s]: several correlation times of a usual disturbance."""
FEWEST_BLOCKS = 20
"""A short recording has shorter blocks, so that each of the five folds still has four."""
FOLDS = 5
"""Folds of the cross-validation."""
HELD_BACK = 0.01
"""Ridge: a parameter hardly moves where the other folds hold less than this share of the information on it. Near a
breakaway, or at an impact, one block may hold nearly all."""
SHORT_CORRELATION_S = 0.05
"""Largest correlation time of the disturbance torque during the search [s]: a slower one would model friction and slow
effects that are not in the model yet (docs/explanation/gap-statistics.md)."""
CORRELATION_TIMES = 60.0
"""Least ratio of the recordings' duration to the correlation time in the final fit: a slower disturbance is an effect."""
LEAST_WHITE = 1e-3
"""Least white noise, as a share of the torque: no machine's torque is more repeatable from tick to tick."""
WINDOW_S = 0.05
"""Duration of the constant force whose standard error is the noise floor [s]."""
LASTING_S = 0.02
"""Time over which a white force is averaged for the missing force [s]: above 50 Hz a force hardly moves a shaft."""
LEVEL = 0.005
"""Probability of a false positive, over the whole catalogue."""
SHARE = 0.07
"""Share of the remaining missing power that an effect must remove to be named."""
CLOSED = 0.5
"""Share of the missing power that a law must remove with a slow disturbance, where its evidence is not sufficient there."""
EXPLAINED = 0.7
"""Share of the missing power that the named effects must remove for `effect_found`."""
DRIVE_KEPT = 0.3
"""Share of the driving torque, and of the moving samples, that a law must keep: one that cancels the drive fits anything."""
STRUCTURE_SHARE = 0.03
"""Share of the remaining missing power that a function of one coordinate must explain to be structure."""
MATTERS = 0.001
"""Share of the initial missing power from which remaining structure matters: 3 % of the force."""
UNSTRUCTURED_SHARE = 0.3
"""Share of the torque of friction and current from which a missing force without structure is reported as unexplained."""
BASE_PRIOR = 1.5
"""Standard deviation of the prior on the logarithm of a free base parameter: a factor of 4.5."""
NOISE_FACTOR = 2.0
"""A missing force counts as none below this multiple of the least noise, or of the noise floor."""
MOVES = 0.5
"""A shaft moves if Coulomb friction leaves more than this share of its velocity after a period. Otherwise it sticks, and a
force has no visible effect."""
ORDER_GAIN = 10.0
"""Least expected gain of an order of a ripple [nats]: the best of ninety exceeds it by chance in one run of two hundred."""
ORDER_SHARE = 0.02
"""Share of the joint gain of all orders of a ripple that one more must add: many small orders would fit any function."""
GRIP_BLOCKS = 2
"""Least duration of a grip in blocks: when one block is held out, another one still contains the grip."""
LINE = 25.0
"""Ratio of power to that of neighbouring frequencies from which a frequency is a spectral line; hardly ever by chance."""
IMITATIONS = 5
"""Simulated recordings of the parametric bootstrap: together they have at least a hundred blocks."""
INDISTINGUISHABLE = 3.0
"""Standard errors up to which two laws are tied."""
MOST_EFFECTS = 4
"""Most laws that are added."""
