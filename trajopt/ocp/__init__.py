"""Optimal control of hybrid systems by direct collocation.

The engine knows nothing of any particular system. From the bottom to the top:

    constraints, problem        phases of smooth motion, linkages between them, bounds, costs
    schemes, mesh, trajectory   how a problem is discretised
    scaling                     what counts as one: results do not depend on units
    layout, equations, program, transcription
                                the problem on a mesh as a nonlinear program, solved by IPOPT
    accuracy, resimulation      errors between the nodes, costates; an independent simulation
    extremal                    a solved problem: report, file
    refinement, guesses, solve  from a guess to a local minimum on a mesh that is fine enough
    multi_start, continuation   many starts; following a solution along a parameter

"""
