"""Motion cueing: from a vehicle's accelerations to setpoints of a platform."""
