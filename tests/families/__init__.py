"""Random families of problems, each judged by an oracle that shares no code with the library."""
