"""Tells colcon what to install and where; usvnet itself comes from pip."""

from setuptools import setup

NAME = "usvnet_ros"

setup(
    name=NAME,
    version="0.1.0",
    description="Boats and their ranges in a camera's images, as vision_msgs detections with covariance.",
    license="Apache-2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/ranging.launch.py"]),
        (f"share/{NAME}/config", ["config/ranging.yaml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={"console_scripts": [f"ranging = {NAME}.node:main"]},
)
