"""The result of an integration: missing cloth, and the state of each pixel.

In: an integration and a session's document. Out: areas, reasons, counts; for the page, exports and reports.
"""
