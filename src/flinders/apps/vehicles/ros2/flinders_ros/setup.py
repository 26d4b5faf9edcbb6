"""Installs the package for colcon."""

from setuptools import setup

NAME = "flinders_ros"

setup(
    name=NAME,
    version="@VERSION@",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/calibrate.launch.py"]),
    ],
    install_requires=["setuptools", "flinders"],
    zip_safe=True,
    maintainer="The Flinders developers",
    description="Calibrates the magnetometer of a robot while it works.",
    license="BSD-3-Clause",
    entry_points={"console_scripts": ["calibrate = flinders_ros.node:main"]},
)
