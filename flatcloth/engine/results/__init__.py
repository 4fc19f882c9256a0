"""What an integration has come to: the result with what is missing, and what became of each pixel.

In: an integration and a session's document. Out: areas, reasons, counts; for the page, exports and reports.
"""
