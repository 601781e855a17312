"""Records unlike the simulator's: machines of other people, in other people's files, with what is wrong with these.

    python -m benchmarks.gap.foreign -o DIR --seed 0 --cases 120

A case is drawn from (seed, number): a machine (`machines`: a robot joint, an axis under a position loop, a driven pendulum,
a motor with cogging, a slow drive), a friction, a fault of the record (`record`), and a config that somebody would have
(`nominal`: of `identify`, with or without its uncertainty, or a guess). `simulate` integrates it and shares nothing with
``hapticd``. The workflow gets record.csv, map.yaml and model.yaml, and reads them through the public import.

What is right (`truth`, `judge`)
    A hidden ingredient makes one or several names right: friction that grows less than linearly is quadratic_drag with d < 0
    or stribeck with s < 0. *Near* names look alike on poor data: they may be said with doubt, not alone.
    inertia_error is right where the inertia comes within 10 % of the true one, or half of the way to it (as a logarithm).
    viscous_friction and coulomb_friction are right where friction has another law than the config's, else as the inertia,
    with 20 %; torque_constant_error where all that it changes comes nearer to the truth.
    Positions that are stale by a constant are the same as a delay of the device, so that transport_delay and amplifier_lag
    are right. A measured current that is late or filtered is a fault of the record: no effect is right for it.

What an answer is, the worst of its names counting
    right     every name is right; or no_missing_effect where config and motor torque part by less than 10 % (RMS)
    abstains  unexplained; ambiguous with a right one tied to each name that is not; a near name said with doubt; right
              names beside an inertia that is off by more than 20 %, where the verdict says that something is left
    missed    no_missing_effect although more is missing; effect_found beside such an inertia
    doubted   a name that is neither right nor near, with a sentence of doubt about it, or tied to others, none of them right
    wrong     *confidently wrong*: such a name without doubt, or a near one without doubt
    failed    an error
Doubt about a name is a parameter of it at a bound, a flexible function that predicts better, or a tie.

Wanted: right or abstaining ≥ 95 %, confidently wrong ≤ 2 %. On slow drives the inertia, fitted or kept, within 5 %.
"""
