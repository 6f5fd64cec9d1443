#!/bin/sh
# Stands in for a Python with MuJoCo: `-m tiller_tools.mjcf ROBOT.xml OUT` gets what MuJoCo has said of it once.
exec cp "${3%.*}.json" "$4"
