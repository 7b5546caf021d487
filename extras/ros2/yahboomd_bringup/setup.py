"""The bring-up package, for colcon."""

from glob import glob

from setuptools import setup

NAME = "yahboomd_bringup"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{NAME}/rviz", sorted(glob("rviz/*.rviz"))),
    ],
    entry_points={"console_scripts": [f"resident = {NAME}.resident:main"]},
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="yahboomd",
    maintainer_email="yahboomd@packages.invalid",
    description="Launch files for a robot that yahboomd drives.",
    license="Apache-2.0",
)
