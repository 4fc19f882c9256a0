"""flatcloth: integrate turned RGB-D views of a hanging garment into its canonical shape.

The method is that of Kita & Kita, "Integration of Multiple RGB-D Data of a Deformed Clothing
Item into Its Canonical Shape"; the word paper in the docstrings of this package means that article.
"""

__version__ = "0.1.0"
