"""Synthesis of recordings with truth from a garment mesh: hang, turn, render, add sensor noise.

Input: a mesh file. Output: a recording folder with the truth of each view.
"""
