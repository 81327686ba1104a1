"""MLS-MPM in other packages, written from the method's equations, to measure gic against."""
