# gda_tracker on ROS 2 Jazzy.
#
#   docker build -t gda_tracker .
#   docker run --rm --net=host --ipc=host gda_tracker \
#     ros2 launch gda_tracker tracker.launch.py topic:=/radar/points preset:=continental_ars548
FROM ros:jazzy-ros-base

SHELL ["/bin/bash", "-o", "pipefail", "-c"]
ENV DEBIAN_FRONTEND=noninteractive

# Messages of others that tracks are read from and given out in, and the libraries for bags and
# reports, which are no ROS packages.
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        python3-colcon-common-extensions \
        python3-matplotlib \
        python3-pip \
        ros-jazzy-radar-msgs \
        ros-jazzy-ros2bag \
        ros-jazzy-rosbag2-storage-mcap \
        ros-jazzy-vision-msgs \
    && rm -rf /var/lib/apt/lists/*
RUN pip install --no-cache-dir --break-system-packages "rosbags>=0.11,<0.12" tqdm

WORKDIR /workspace
# The manifests first: the dependencies are installed again only when these change.
COPY package.xml src/gda_tracker/package.xml
COPY msg_schemas/package.xml src/gda_tracker/msg_schemas/package.xml
RUN apt-get update \
    && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths src/gda_tracker src/gda_tracker/msg_schemas \
        --ignore-src --dependency-types=build --dependency-types=buildtool \
        --dependency-types=exec -y \
    && rm -rf /var/lib/apt/lists/*

COPY setup.py setup.cfg pyproject.toml README.md LICENSE src/gda_tracker/
COPY resource src/gda_tracker/resource
COPY params src/gda_tracker/params
COPY launch src/gda_tracker/launch
COPY data src/gda_tracker/data
COPY msg_schemas src/gda_tracker/msg_schemas
COPY gda_tracker src/gda_tracker/gda_tracker
RUN . /opt/ros/jazzy/setup.sh \
    && colcon build --base-paths src/gda_tracker src/gda_tracker/msg_schemas \
        --event-handlers console_direct+ --cmake-args -DBUILD_TESTING=OFF

COPY docker/entrypoint.sh /entrypoint.sh
# `gda-tracker` on the path: a workspace has scripts where ros2 run looks for them.
ENV PATH="/workspace/install/gda_tracker/lib/gda_tracker:${PATH}"
ENTRYPOINT ["/entrypoint.sh"]
CMD ["ros2", "launch", "gda_tracker", "tracker.launch.py"]
