"""All metadata, for colcon (ament_python) and pip alike; pyproject.toml holds the build system and tools only."""

import re
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = "uw_recon_ros"
# colcon --symlink-install runs a link to this file from the build folder
ROOT = Path(__file__).resolve().parent
#: The one place of the version is package.xml, where ROS's tools look for it.
VERSION = re.search(r"<version>(.*?)</version>", (ROOT / "package.xml").read_text(encoding="utf-8"))[1]
NODES = [
    "preprocess_node",
    "rectify_node",
    "disparity_node",
    "point_cloud_node",
    "pipeline_node",
    "odometry_node",
    "model_node",
    "calibrate_node",
    "bag_player_node",
    "web_node",
]
MESSAGES = ["sensor-msgs", "nav-msgs", "stereo-msgs", "diagnostic-msgs", "std-srvs", "visualization-msgs"]
MESSAGES += ["rosgraph-msgs", "lifecycle-msgs"]
#: Rooms that hold parts of pages.
PAGES = ["report", "survey"]
DASK, LAZ = ["distributed>=2024.1"], ["laspy>=2.5", "lazrs>=0.5"]
VIDEO, NETWORK = ["av>=11"], ["onnxruntime>=1.17"]
#: rawpy: MIT, with LibRaw (LGPL 2.1 or CDDL); pi-heif: BSD, with libheif and libde265 (LGPL), no encoder.
RAW = ["rawpy>=0.21", "pi-heif>=0.18"]
COMPLETION = ["argcomplete>=3"]
MODEL = ["fast-simplification>=0.1.9"]
DOCS = ["sphinx>=7.2", "myst-parser>=3", "furo>=2024.1.29"]
TEST = [
    "pytest>=7.4",
    "pytest-xdist>=3",
    "pytest-timeout>=2.1",
    "hypothesis>=6.80",
    "psutil>=5.9",
    "coverage>=7.10",
    *DASK,
    *LAZ,
    *VIDEO,
    *RAW,
    *NETWORK,
    "onnx>=1.15",
    *COMPLETION,
    *MODEL,
    "rasterio>=1.3",
    "pyproj>=3.5",
]


def ros_wheels(distro: str) -> list[str]:
    """Return the wheels that stand in for an installed ROS 2."""
    return [f"ros-{distro}-{name}" for name in ["rclpy", "rmw-fastrtps-cpp", *MESSAGES]]


setup(
    name=NAME,
    version=VERSION,
    description="Underwater stereo reconstruction as a ROS 2 node graph",
    long_description=(ROOT / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    author="The uw_recon_ros maintainers",
    author_email="maintainers@users.noreply.example",
    license="Apache-2.0",
    classifiers=[
        "License :: OSI Approved :: Apache Software License",
        "Programming Language :: Python :: 3.10",
        "Programming Language :: Python :: 3.11",
        "Programming Language :: Python :: 3.12",
        "Programming Language :: Python :: 3.13",
        "Programming Language :: Python :: 3.14",
        "Topic :: Scientific/Engineering :: Image Recognition",
    ],
    keywords=["ROS", "stereo", "underwater", "reconstruction"],
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", *(f"{room}/*.{kind}" for room in PAGES for kind in ("html", "css", "js"))]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{NAME}/config", sorted(glob("config/*.*"))),
        (f"share/{NAME}/config/security", sorted(glob("config/security/*"))),
        (f"share/{NAME}/config/rviz", sorted(glob("config/rviz/*"))),
        (f"share/{NAME}/config/foxglove", sorted(glob("config/foxglove/*"))),
    ],
    python_requires=">=3.10",
    install_requires=[
        "setuptools",
        "numpy>=1.26",
        "scipy>=1.11",
        "opencv-python-headless>=4.6",
        "PyWavelets>=1.4",
        "rosbags>=0.10",
        "mcap>=1.1",
        "lz4",
        "zstandard",
        "numba>=0.59",
        "trimesh>=4.0",
        "pillow>=9",
        "PyYAML>=6",
        "Jinja2>=3.0",
        "tqdm>=4.60",
        "tifffile>=2022.5",
    ],
    extras_require={
        "ros-jazzy": ros_wheels("jazzy"),
        "ros-kilted": ros_wheels("kilted"),
        "dask": DASK,
        "laz": LAZ,
        "model": MODEL,
        "video": VIDEO,
        "raw": RAW,
        "network": NETWORK,
        "completion": COMPLETION,
        "test": TEST,
        "docs": DOCS,
        "dev": [*TEST, *DOCS, "ruff~=0.17.6", "mypy~=2.4.1", "scipy-stubs", "types-PyYAML", "types-tqdm"],
    },
    zip_safe=False,
    entry_points={
        "console_scripts": [
            *(f"{node} = {NAME}.executables:{node}" for node in NODES),
            f"uw_recon = {NAME}.executables:uw_recon",
        ]
    },
)
