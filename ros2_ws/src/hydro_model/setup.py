"""Package hydro_model (ament_python)."""

from setuptools import find_packages, setup

PACKAGE = "hydro_model"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "robots/*/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Hydro maintainers",
    maintainer_email="hydro-maintainers@example.com",
    description="The shared model of a hydraulic manipulator.",
    license="Apache-2.0",
    entry_points={"console_scripts": []},
)
