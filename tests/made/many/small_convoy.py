"""Settings of a small convoy without noise and jitter: two cars in a bend, for two seconds."""

SETTINGS = (
    "convoy.vehicles=2", "duration_s=2.0", "control.rate_hz=10", "gnss.rate_hz=5",
    "gnss.position_noise_m=0", "gnss.heading_noise_deg=0", "gnss.speed_noise_mps=0",
    "gnss.yaw_rate_noise_radps=0", "control.own_state='exact'", "parameters.tyres='linear'",
    "speed.set_mps=20", "speed.lateral_acceleration_mps2_max=20",
    "path.segments=[{length_m=2.0}, {length_m=60.0, radius_m=80.0, turn='right'}]",
    "links.jitter_ms=0", "links.latency_ms=20",
)  # fmt: skip
