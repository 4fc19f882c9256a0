"""The shape of a set of views, computed from nothing; :mod:`flatcloth.shape.algorithm` tells it in order."""
