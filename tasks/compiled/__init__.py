"""What members of the library write each tick, compiled: a member names its kernel, and a plan imports it."""
