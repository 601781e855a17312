"""The catalogue of effects: physics that a device may have beyond eq. 1, one file an effect.

Each file holds what is known of the effect (``EFFECT``) and its law as a kernel; `hapticd.plant.numeric` puts the laws
together into the motion of a device. Parameters and their bounds are config keys: `hapticd.config.effect_parameters`.
"""
