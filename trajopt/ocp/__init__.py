"""Optimal control of hybrid systems by direct collocation.

The engine knows nothing of any particular system. Its folders are floors; each imports only from
those before it:

    pose        phases of smooth motion, linkages between them, bounds, costs
    transcribe  schemes and meshes; the problem on a mesh as a nonlinear program for IPOPT
    judge       how good a solution on a mesh is: errors between the nodes, costates, playback
    results     a solved problem: figures, report, file, pictures
    solving     from a guess to a local minimum on a mesh that is fine enough
    search      many starts, and following a solution along a parameter

`arrays`, `checks` and `interrupted` lie below all of them; `textbook` has problems with known
answers.
"""
