"""Many training runs from one experiment: a grid, its runs in processes of their own, and the tables at the end.

:mod:`grid` says which runs there are, :mod:`plan` what each of them trains with, :mod:`one_run` trains and scores one,
:mod:`local` and :mod:`ray_tune` start them, :mod:`board` shows how far they are; :mod:`cost`, :mod:`tables`,
:mod:`figure` and :mod:`report` make the results.
"""
