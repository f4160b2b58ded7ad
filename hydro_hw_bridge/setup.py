"""Package hydro_hw_bridge (ament_python)."""

from setuptools import find_packages, setup

PACKAGE = "hydro_hw_bridge"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "rig/truths/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Hydro maintainers",
    maintainer_email="hydro-maintainers@example.com",
    description="CAN bridge and simulated machine of a hydraulic manipulator.",
    license="Apache-2.0",
    entry_points={
        "can.interface": [
            "simulated_faults = hydro_hw_bridge.bus.simulated_faults:SimulatedFaultsBus",
        ],
        "console_scripts": [
            "can_bridge = hydro_hw_bridge.node.bridge_node:main",
            "sim_rig = hydro_hw_bridge.rig.command:main",
            "calibrate = hydro_hw_bridge.commissioning.calibrate:main",
            "new_bus = hydro_hw_bridge.commissioning.new_bus:main",
        ],
    },
)
