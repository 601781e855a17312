"""Imported last by the server of `tests.forked`: its objects are no garbage.

A collection in a child would look at every one of them, and so copy the pages of all: half a second and 50 MB a child.
"""

import gc

gc.collect()
gc.freeze()
