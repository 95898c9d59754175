"""The robots that come with the library, as URDF of primitive shapes."""
