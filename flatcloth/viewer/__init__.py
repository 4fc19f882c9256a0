"""The operator page: one web server for the page, its messages and viser's 3D scene.

Only this package uses viser and the web server.
"""
