"""The findings of every experiment, as sentences for the report."""

FINDINGS: dict[int, tuple[str, ...]] = {
    1: (
        "Cost 4.3: 738.54 is no optimum. A passive step costs nothing, and so does one that "
        "balances passively for any length of time. The cost does not determine the duration, "
        "and a solver may end anywhere. Every start finds a cost of 0; the quickest is shown.",
        "Cost 4.4: the printed 0.040904 and 0.001559 J are right.",
    ),
    2: (
        "The printed bound of 3 pi on the last theta' cannot have been in force: no collisionless "
        "step ends with less than 4.08 pi. With 8 pi the optimum costs 1.6 % more than printed, "
        "which is within what the thesis's mesh tolerance of 1e-3 leaves open.",
        "Its foot would have to be held down with almost six times the machine's weight, and no "
        "collisionless step needs less than 3.4 times. With a foot that can only push there is "
        "none: the experiment walks on its pin joint.",
    ),
    3: (
        "The printed costs are 280 to 1050 times too high: none of them is an optimum. Walking "
        "without losses needs almost no control.",
        "(4.10) is printed with the weights of (4.9): it is the same problem, with two different "
        "printed results.",
        "Where m2 is to be chosen it goes to its lower bound, whatever that is: the lighter the "
        "pendulum, the less it swings. The printed problem, without bounds, has no solution.",
        "Relabelled touchdowns lose no energy, so there is nothing to save. With real touchdowns, "
        "periodic steps and electrical energy per weight and distance as the cost, m2 has an "
        "optimum within its bounds.",
    ),
    4: ("As in Experiment 3: an almost passive walk, 480 times cheaper than printed.",),
    5: (
        "The printed 1999.99 is hundreds of times too high under either impact law and either "
        "printed bound on phi'(0). Listing 4.2 bounds the cost of every phase by 1000: two phases "
        "at that bound cost 2000.",
        "The optima for the pinned foot pull at the ground. With a foot that can only push and "
        "must not slip, they cost more.",
    ),
    6: (
        "Elastic: the printed 0.040907 is right. The energy of both steps is 0.003121 J, 4e-6 J "
        "less than printed.",
        "Plastic: a first step that ends where and when that of Experiment 5 does, and a second "
        "one from there, must together cost what Experiment 5 costs (Bellman's principle). They "
        "do. "
        "That the thesis's chain costs half of its Experiment 5 shows that neither converged.",
    ),
}
