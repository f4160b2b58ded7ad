"""Package hydro_ident (ament_python)."""

from setuptools import find_packages, setup

PACKAGE = "hydro_ident"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "report/assets/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Hydro maintainers",
    maintainer_email="hydro-maintainers@example.com",
    description="Identification of a hydraulic manipulator from recorded bags.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "recorder = hydro_ident.bag.recorder:main",
            "player = hydro_ident.bag.player:main",
            "identification_node = hydro_ident.identify.identification_node:main",
            "check_robot = hydro_ident.commands.check_robot:main",
            "inspect = hydro_ident.commands.inspect:main",
            "tracking = hydro_ident.commands.tracking:main",
            "identify = hydro_ident.commands.identify:main",
            "excite = hydro_ident.commands.excite:main",
            "nominal = hydro_ident.commands.nominal:main",
            "compare_tracking = hydro_ident.commands.compare_tracking:main",
            "convert = hydro_ident.commands.convert:main",
            "diagnose = hydro_ident.commands.diagnose:main",
            "study = hydro_ident.study.command:main",
        ]
    },
)
