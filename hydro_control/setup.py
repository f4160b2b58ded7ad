"""Package hydro_control (ament_python)."""

from setuptools import find_packages, setup

PACKAGE = "hydro_control"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "config/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Hydro maintainers",
    maintainer_email="hydro-maintainers@example.com",
    description="Model-based valve control of a hydraulic manipulator.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "controller = hydro_control.node.node:main",
            "lifecycle = hydro_control.node.lifecycle_command:main",
            "send_path = hydro_control.node.send_path:main",
        ]
    },
)
