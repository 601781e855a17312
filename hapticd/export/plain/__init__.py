"""One axis in plain Python, of the standard library alone: what ``hapticd model export --to python`` writes, as it is.

The laws are those of the catalogue of effects. A step is divided into parts; in a part what varies with position or speed is
taken as its mean over the way (second order), constant torques and viscous friction are in closed form, and stops, impacts
and switches of the current are located. That they move as hapticd's own plant does is tested for every effect.
"""
