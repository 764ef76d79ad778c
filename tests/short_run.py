"""Settings of an experiment that takes seconds."""

# a small contact in a small picture: 0.03 N, 0.86 mm, 22 um of travel
SHORT = (
    "camera.width=400",
    "camera.height=300",
    "run.normal_force=0.03",
    "run.travel=22",
    "run.background_time=0.5",
    "run.settle_time=0.3",
    "run.settle_tolerance=0.1",
    "run.shear_tolerance=0.2",
    "sim.force_noise=0.02",
    "sim.press_time=0.75",
)
