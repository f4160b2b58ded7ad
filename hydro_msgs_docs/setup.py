"""Package hydro_msgs_docs (ament_python)."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "hydro_msgs_docs"
TOOLS = ("foxglove", "plotjuggler", "rqt", "rviz")
HERE = Path(__file__).parent

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "fastdds.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *(
            (f"share/{PACKAGE}/{folder}", sorted(str(p.relative_to(HERE)) for p in files))
            for folder in ("can", *(f"layouts/{tool}" for tool in TOOLS))
            if (files := list(HERE.glob(f"{folder}/*")))
        ),
    ],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Hydro maintainers",
    maintainer_email="hydro-maintainers@example.com",
    description="Topics, bus and bag contract: pages, and the library that the nodes run by.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "live_layouts = hydro_msgs_docs.layouts_command:main",
            "visual_urdf = hydro_msgs_docs.visual_command:main",
            "visual_joints = hydro_msgs_docs.visual_node:main",
        ],
    },
)
