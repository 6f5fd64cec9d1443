#!/bin/sh
# imported.sh TILLER EVERY_PLANNER TICKS DESCRIPTION...: each description as it is imported, so many ticks with every planner.
# MEMCHECK in the environment goes before the program.
set -eu
tiller=$1 every_planner=$2 ticks=$3
shift 3
rm -rf imported && mkdir imported
for description; do
  folder=imported/$(basename "$description" | sed 's/\..*//')
  "$tiller" import "$description" -o "$folder"
done
$MEMCHECK "$every_planner" "$ticks" imported/*/robot.toml
