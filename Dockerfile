# syntax=docker/dockerfile:1
# ROS 2 with the nodes and the command line, for amd64 and arm64; the kernels are compiled while it is built.
#   docker build -t uw_recon_ros .
#   docker buildx build --platform linux/amd64,linux/arm64 -t uw_recon_ros .
#   docker build --build-arg ROS_DISTRO=lyrical -t uw_recon_ros .            another ROS 2: jazzy (default), kilted, lyrical
#   docker run --rm --net host --ipc host uw_recon_ros                       the nodes, and a page on port 8011
#   docker run --rm -v "$PWD:/data" uw_recon_ros uw_recon survey dive -o out one dive, offline
ARG ROS_DISTRO=jazzy
FROM ros:${ROS_DISTRO}-ros-base
ARG ROS_DISTRO

SHELL ["/bin/bash", "-o", "pipefail", "-c"]

# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends python3-venv "ros-${ROS_DISTRO}-stereo-msgs" \
    && rm -rf /var/lib/apt/lists/*

COPY . /src
# ROS 2's rclpy comes from the system; everything else goes into the environment, which ament finds as a prefix.
# hadolint ignore=DL3013
RUN python3 -m venv --system-site-packages /opt/uw_recon \
    && /opt/uw_recon/bin/pip install --no-cache-dir '/src[video,laz,raw]' \
    && mkdir -p /opt/uw_recon/lib/uw_recon_ros \
    && ln -s /opt/uw_recon/bin/*_node /opt/uw_recon/lib/uw_recon_ros/ \
    && rm -rf /src

# Any processor of the architecture runs what was compiled here: a name of its own for the one that built would not fit.
ENV PATH=/opt/uw_recon/bin:$PATH \
    AMENT_PREFIX_PATH=/opt/uw_recon \
    NUMBA_CPU_NAME=generic \
    NUMBA_CPU_FEATURES="" \
    NUMBA_CACHE_DIR=/var/cache/uw_recon_ros

RUN useradd --create-home --uid 1001 recon && install -d -o recon /var/cache/uw_recon_ros /data
USER 1001
RUN uw_recon warmup

# BlueOS: what its extension manager shows and runs. It finds the page by looking through the ports that listen.
LABEL version="0.1.0" \
    type="tool" \
    requirements="core >= 1.1" \
    authors='[{"name": "The uw_recon_ros maintainers", "email": "maintainers@users.noreply.example"}]' \
    company='{"about": "Underwater stereo reconstruction", "name": "uw_recon_ros", "email": "maintainers@users.noreply.example"}' \
    readme="" \
    links='{}' \
    tags='["camera", "stereo", "mapping"]' \
    permissions='{"HostConfig": {"NetworkMode": "host", "IpcMode": "host", "Binds": ["/usr/blueos/extensions/uw_recon_ros:/data"]}}'

WORKDIR /data
EXPOSE 8011
CMD ["ros2", "launch", "uw_recon_ros", "uw_recon.launch.py", "composed:=true", "preset:=navigation", "web:=true"]
