#!/usr/bin/env bash
# Builds ROS 2's compiled programs from their release sources, for `make ros-programs`:
#   ros_programs.sh FOLDER [PACKAGE ...]
# ros_programs.txt lists the packages, each after those that it needs; PACKAGE ... builds these alone. Everything is in
# FOLDER: src, build, install, log, and env.sh, which is to be sourced. What is built is left alone; another tag in the
# list builds it anew. Beneath are the wheels that `make interop` has installed, or a sourced ROS 2, whose own packages
# are used where it has them. JOBS: compilers at a time (1).
# From the system (Debian): cmake ninja-build g++ libeigen3-dev libtinyxml2-dev libconsole-bridge-dev liborocos-kdl-dev
# libyaml-cpp-dev liburdfdom-dev libceres-dev libsuitesparse-dev libboost-all-dev uuid-dev libgeographic-dev
# Exit code: 0 all built, 1 something is missing (said which, and its log), 2 wrong arguments.
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
[ $# -ge 1 ] || { sed -n '2,11s/^# \{0,1\}//p' "$0" >&2; exit 2; }
mkdir -p "$1"
folder="$(cd "$1" && pwd)"
shift
install="$folder/install"
mkdir -p "$folder"/{src,build,log} "$install"/{lib,share/ament_index/resource_index/packages}

given=()
if [ -n "${AMENT_PREFIX_PATH:-}" ]; then
  base="$AMENT_PREFIX_PATH"
  libraries="${LD_LIBRARY_PATH:-}"
else
  base="${YAHBOOMD_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/yahboomd}/interop/ros-jazzy"
  [ -x "$base/bin/python" ] || { echo "ros_programs: no ROS 2 is sourced, and no $base: \`make interop\` installs it" >&2; exit 1; }
  libraries="$base/lib:$(echo "$base"/lib/python3*/site-packages/ros_*.libs | tr ' ' ':')"
  export PATH="$base/bin:$PATH"
  # The wheels' libraries expect an interpreter around them.
  linked="$("$base/bin/python" -c "from sysconfig import get_config_var as the; at = the('LIBDIR')
print(f'-L{at} -Wl,-rpath,{at} -lpython' + the('LDVERSION'))")"
  given+=("-DCMAKE_EXE_LINKER_FLAGS=-Wl,--allow-shlib-undefined -Wl,--no-as-needed $linked"
    "-DPython3_EXECUTABLE=$base/bin/python" -DPython3_FIND_VIRTUALENV=ONLY)
  # What ROS 2 wraps in packages comes from the system.
  vendor() { # package, what it provides
    mkdir -p "$install/share/$1/cmake"
    printf '%s\n' "set($1_FOUND TRUE)" "$2" >"$install/share/$1/cmake/$1Config.cmake"
  }
  vendor console_bridge_vendor 'find_package(console_bridge REQUIRED)'
  vendor orocos_kdl_vendor 'find_package(orocos_kdl REQUIRED)'
  vendor yaml_cpp_vendor 'find_package(yaml-cpp REQUIRED)
if(NOT TARGET yaml-cpp::yaml-cpp)
  add_library(yaml-cpp::yaml-cpp INTERFACE IMPORTED)
  target_link_libraries(yaml-cpp::yaml-cpp INTERFACE yaml-cpp)
endif()'
  vendor tinyxml2_vendor 'if(NOT TARGET tinyxml2::tinyxml2)
  add_library(tinyxml2::tinyxml2 INTERFACE IMPORTED)
  target_link_libraries(tinyxml2::tinyxml2 INTERFACE tinyxml2)
endif()
list(APPEND CMAKE_MODULE_PATH "${CMAKE_CURRENT_LIST_DIR}")'
  # nav2_core's header for navigators needs it, which nothing here is.
  vendor nav2_behavior_tree ''
  printf '%s\n' 'set(TinyXML2_FOUND TRUE)' 'set(TinyXML2_LIBRARIES tinyxml2::tinyxml2)' \
    >"$install/share/tinyxml2_vendor/cmake/FindTinyXML2.cmake"
fi

# After each project(): a bondcpp without its target, as releases before 4.1 have it.
cat >"$folder/project.cmake" <<'CMAKE'
if(NOT PROJECT_NAME MATCHES "^(bond|bondcpp|smclib)$")
  find_package(bondcpp QUIET)
  if(bondcpp_FOUND AND NOT TARGET bondcpp::bondcpp)
    add_library(bondcpp::bondcpp INTERFACE IMPORTED)
    target_link_libraries(bondcpp::bondcpp INTERFACE ${bondcpp_LIBRARIES})
    target_include_directories(bondcpp::bondcpp INTERFACE ${bondcpp_INCLUDE_DIRS})
  endif()
endif()
CMAKE

cat >"$folder/env.sh" <<ENV
export AMENT_PREFIX_PATH="$install:$base"
export CMAKE_PREFIX_PATH="$install:$base\${CMAKE_PREFIX_PATH:+:\$CMAKE_PREFIX_PATH}"
export LD_LIBRARY_PATH="$install/lib:$libraries"
export PYTHONPATH="$(echo "$install"/lib/python3*/site-packages)\${PYTHONPATH:+:\$PYTHONPATH}"
ENV
# shellcheck disable=SC1091
. "$folder/env.sh"

fetched() { # repository, tag: the folder with it
  local at="$folder/src/${1//\//+}@${2//\//+}"
  if [ ! -d "$at" ]; then
    git -c advice.detachedHead=false clone -q --depth 1 --branch "$2" "https://github.com/$1" "$at.part" || return
    [ "$1" != SteveMacenski/slam_toolbox ] || [ "${#given[@]}" -eq 0 ] || without_rviz "$at.part"
    mv "$at.part" "$at"
  fi
  echo "$at"
}

without_rviz() { # slam_toolbox's folder: its panel, for which there are no wheels
  sed -i -e '/^#### rviz Plugin/,/^pluginlib_export_plugin_description_file(rviz_common/d' \
    -e '/^install(TARGETS SlamToolboxPlugin/,/^)/d' -e '/rviz_\(common\|default\|ogre\|rendering\)/d' \
    -e '/SlamToolboxPlugin/d' -e '/Qt5/d' -e 's/ rviz_plugins.xml//' "$1/CMakeLists.txt"
}

compiled() { # source, package, its own arguments
  local source="$1" name="$2"
  shift 2
  nice -n 19 cmake -G Ninja -S "$source" -B "$folder/build/$name" -DCMAKE_INSTALL_PREFIX="$install" \
    -DBUILD_TESTING=OFF -DCMAKE_CXX_STANDARD=17 -DCMAKE_BUILD_TYPE= -DCMAKE_CXX_FLAGS_RELEASE= \
    -DCMAKE_CXX_FLAGS="${CXXFLAGS:--O1} -w -I/usr/include/eigen3" -DCMAKE_FIND_USE_PACKAGE_REGISTRY=OFF \
    -DCMAKE_PROJECT_INCLUDE="$folder/project.cmake" "${given[@]}" "$@" &&
    nice -n 19 ninja -C "$folder/build/$name" -j "${JOBS:-1}" install
}

files() { # source, package: one that is made of files for others
  mkdir -p "$install/share/$2"
  cp -r "$1"/* "$install/share/$2/"
  touch "$install/share/ament_index/resource_index/packages/$2"
}

wanted=" $* "
missing=()
while read -r name repository tag part more; do
  case "$name" in '' | '#'*) continue ;; esac
  [ "$wanted" = "  " ] || [[ "$wanted" == *" $name "* ]] || continue
  [ "$(cat "$folder/build/$name.done" 2>/dev/null)" != "$repository $tag" ] || continue
  began=$SECONDS
  # shellcheck disable=SC2086
  if at="$(fetched "$repository" "$tag")" && {
    if [ "$more" = files ]; then files "$at/$part" "$name"; else compiled "$at/$part" "$name" $more; fi
  } >"$folder/log/$name.log" 2>&1 </dev/null; then
    echo "$repository $tag" >"$folder/build/$name.done"
    echo "ros_programs: $name $tag in $((SECONDS - began)) s"
  else
    missing+=("$name")
    echo "ros_programs: NOT built: $name: $folder/log/$name.log" >&2
  fi
done <"$here/ros_programs.txt"
[ "${#missing[@]}" -eq 0 ] || exit 1
echo ". $folder/env.sh"
