"""Work on a second core: a copy of this process, and how its values come back."""
