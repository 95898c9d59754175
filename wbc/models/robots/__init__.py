"""The robots that come with the library, as URDF of primitive shapes; ``tests/models/own_robots.py`` writes them."""
