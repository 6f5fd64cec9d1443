# OSQP for planner.qp_solver = "osqp". Its C sources come with the Python wheel (tools/dev/requirements.txt; `./dev
# setup` installs it) and are compiled from there, as one object whose symbols are all local but the six of
# tiller_osqp.h: a program may link an OSQP of its own beside. Sets TILLER_HAS_OSQP.
option(TILLER_WITH_OSQP "OSQP as a solver of sqp's quadratic programs, if its wheel is in TILLER_VENV" ON)
set(TILLER_HAS_OSQP FALSE)
if(NOT TILLER_WITH_OSQP)
  return()
endif()
file(GLOB found ${TILLER_VENV}/lib*/python3*/site-packages/osqp/codegen/codegen_src/src/osqp_api.c)
if(NOT TILLER_VENV OR NOT found OR NOT CMAKE_OBJCOPY)
  message(STATUS "OSQP: not built, so planner.qp_solver = \"osqp\" is refused. Its sources come with the wheel osqp of "
    "tools/dev/requirements.txt: run ./dev setup, or set TILLER_VENV to an environment that has it")
  return()
endif()
list(GET found 0 found)
get_filename_component(source_dir ${found} DIRECTORY)
get_filename_component(root ${source_dir} DIRECTORY)
set(port ${PROJECT_SOURCE_DIR}/runtime/planners/qp/osqp_port)
add_library(tiller_osqp_object OBJECT ${port}/tiller_osqp.c)
set_target_properties(tiller_osqp_object PROPERTIES C_STANDARD 11 C_VISIBILITY_PRESET hidden)
target_include_directories(tiller_osqp_object BEFORE PRIVATE ${port})
target_include_directories(tiller_osqp_object SYSTEM PRIVATE ${root}/inc/public ${root}/inc/private ${source_dir})
target_compile_options(tiller_osqp_object PRIVATE -O3 -w)
add_custom_command(OUTPUT ${PROJECT_BINARY_DIR}/tiller_osqp.o
  COMMAND ${CMAKE_OBJCOPY} --localize-hidden $<TARGET_OBJECTS:tiller_osqp_object> ${PROJECT_BINARY_DIR}/tiller_osqp.o
  DEPENDS tiller_osqp_object $<TARGET_OBJECTS:tiller_osqp_object> VERBATIM)
add_library(tiller_osqp STATIC ${PROJECT_BINARY_DIR}/tiller_osqp.o)
set_source_files_properties(${PROJECT_BINARY_DIR}/tiller_osqp.o PROPERTIES EXTERNAL_OBJECT TRUE GENERATED TRUE)
set_target_properties(tiller_osqp PROPERTIES LINKER_LANGUAGE C EXPORT_NAME osqp)
target_include_directories(tiller_osqp INTERFACE $<BUILD_INTERFACE:${port}>)
target_link_libraries(tiller_osqp INTERFACE m)
set(TILLER_HAS_OSQP TRUE)
