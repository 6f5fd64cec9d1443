#!/bin/sh
# imported.sh TILLER EVERY_PLANNER TICKS FOLDER "DESCRIPTION [OPTIONS]"...: each description of the folder as it is
# imported, so many ticks with every planner.
# MEMCHECK in the environment goes before the program. An MJCF is left out where TILLER_PYTHON has no package mujoco.
set -eu
tiller=$1 every_planner=$2 ticks=$3 from=$4
shift 4
rm -rf imported && mkdir imported
for description; do
  case $description in *.xml*)
    if ! "$TILLER_PYTHON" -c "import mujoco" 2>/dev/null; then
      echo "$description: left out: $TILLER_PYTHON has no package mujoco"
      continue
    fi ;;
  esac
  # shellcheck disable=SC2086  # a description and its options are several words
  "$tiller" import "$from"/$description -o "imported/${description%%.*}"
done
$MEMCHECK "$every_planner" "$ticks" imported/*/robot.toml
