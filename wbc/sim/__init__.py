"""Plants, disturbances, scenarios, and the loop that runs a controller on them."""
