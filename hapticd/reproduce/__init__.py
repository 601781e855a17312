"""``hapticd reproduce``: every table and figure of the paper, computed by the code that runs the rig.

One module for each table and figure builds an `Item` (figures, tables, and a comparison of the paper's numbers with ours).
`build` creates all items, `page` puts them into one self-contained HTML page. Fig. 1, 2 and 10 are block diagrams without
numbers.
"""
