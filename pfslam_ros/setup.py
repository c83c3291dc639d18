"""How colcon builds and installs the package: its files go where ROS 2 looks for them."""

from glob import glob
from xml.etree import ElementTree

from setuptools import setup

NAME = "pfslam_ros"

setup(
    name=NAME,
    version=ElementTree.parse("package.xml").findtext("version"),
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", glob("config/*.yaml")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="The pfslam authors",
    maintainer_email="maintainer@example.com",
    description="SLAM and localization for robots with a planar LiDAR, by the particle filter of pfslam",
    license="MIT",
    entry_points={"console_scripts": [f"slam = {NAME}.node:main"]},
)
