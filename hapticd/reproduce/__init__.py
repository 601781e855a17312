"""``hapticd reproduce``: every table and figure of the paper, computed by the code that runs the rig.

One module for each table and figure builds an `Item` (figures, tables, and the paper's printed numbers beside ours);
`build` makes them all, `page` puts them into one self-contained HTML page. Fig. 1, 2 and 10 are block diagrams and hold
nothing to compute.
"""
