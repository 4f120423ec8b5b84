"""Reports: one HTML file with tables that can be sorted and plots that can be hovered.

`document` puts parts together, `table` and `plots` make them, `paper` draws the same plots for
print. A report loads nothing, and all that is printed in it is escaped.
"""
