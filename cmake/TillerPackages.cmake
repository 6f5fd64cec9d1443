# Debian packages (`./dev deb`), from a build with -DTILLER_PACKAGES=ON:
#
#   libtiller0.2   libtiller.so.0.2: the C ABI, for programs that link it
#   libtiller-dev  headers, static libraries, CMake package, pkg-config file
#   tiller-tools   the command, its Python tools, robots, message types, the unit for systemd
#
# Every install() names its part by CMAKE_INSTALL_DEFAULT_COMPONENT_NAME, which a folder sets once. The Python package
# is a wheel (`./dev wheel`). The shared library is TillerShared.cmake's.

install(FILES ${PROJECT_SOURCE_DIR}/tools/packaging/tiller@.service DESTINATION lib/systemd/system COMPONENT tools)

set(CPACK_DEBIAN_LIB_PACKAGE_NAME libtiller${TILLER_SONAME})
set(CPACK_DEBIAN_DEV_PACKAGE_NAME libtiller-dev)
set(CPACK_DEBIAN_TOOLS_PACKAGE_NAME tiller-tools)

# What Debian asks of every package: a copyright file and a compressed changelog under its name.
find_program(TILLER_GZIP gzip REQUIRED)
set(kept ${PROJECT_BINARY_DIR}/generated)
file(READ ${PROJECT_SOURCE_DIR}/LICENSE licence)
string(REGEX REPLACE "\n\n" "\n.\n" licence "${licence}")
string(REGEX REPLACE "\n" "\n " licence "${licence}")
file(WRITE ${kept}/copyright "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\n"
  "Upstream-Name: tiller\n\nFiles: *\nCopyright: 2026 The tiller authors\nLicense: BSD-3-Clause\n ${licence}\n")
foreach(page changelog tiller.1)
  execute_process(COMMAND ${TILLER_GZIP} -9nc ${PROJECT_SOURCE_DIR}/tools/packaging/${page}
    OUTPUT_FILE ${kept}/${page}.gz)
endforeach()
install(FILES ${PROJECT_SOURCE_DIR}/tools/packaging/lintian-overrides COMPONENT lib
  DESTINATION ${CMAKE_INSTALL_DATADIR}/lintian/overrides RENAME ${CPACK_DEBIAN_LIB_PACKAGE_NAME})
install(FILES ${kept}/tiller.1.gz DESTINATION ${CMAKE_INSTALL_DATADIR}/man/man1 COMPONENT tools)
foreach(part lib dev tools)
  string(TOUPPER ${part} upper)
  set(folder ${CMAKE_INSTALL_DATADIR}/doc/${CPACK_DEBIAN_${upper}_PACKAGE_NAME})
  install(FILES ${kept}/copyright ${kept}/changelog.gz DESTINATION ${folder} COMPONENT ${part})
endforeach()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME tiller)
set(CPACK_PACKAGE_CONTACT "The tiller authors <tiller@tiller.example>")
set(CPACK_PACKAGE_DIRECTORY ${PROJECT_SOURCE_DIR}/build/debs)
set(CPACK_COMPONENTS_ALL lib dev tools)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE
  WORLD_READ WORLD_EXECUTE)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
# Debian wants a trigger for ldconfig, beside the script that CPack writes.
set(name ${CPACK_DEBIAN_LIB_PACKAGE_NAME})
file(WRITE ${kept}/shlibs "libtiller ${TILLER_SONAME} ${name} (>= ${PROJECT_VERSION})\n")
set(CPACK_DEBIAN_LIB_PACKAGE_CONTROL_EXTRA ${PROJECT_SOURCE_DIR}/tools/packaging/triggers ${kept}/shlibs)
set(CPACK_DEBIAN_LIB_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_ENABLE_COMPONENT_DEPENDS OFF)
set(CPACK_DEBIAN_LIB_PACKAGE_SECTION libs)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
# a model in C++ includes xsimd through our headers
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS "${CPACK_DEBIAN_LIB_PACKAGE_NAME} (= ${PROJECT_VERSION}), libxsimd-dev")
set(CPACK_DEBIAN_DEV_PACKAGE_SUGGESTS "libeigen3-dev")
set(CPACK_DEBIAN_TOOLS_PACKAGE_SECTION science)
set(CPACK_DEBIAN_TOOLS_PACKAGE_DEPENDS "python3:any")
set(CPACK_DEBIAN_TOOLS_PACKAGE_RECOMMENDS "python3-matplotlib, python3-numpy")
set(CPACK_DEBIAN_TOOLS_PACKAGE_SUGGESTS "libtiller-dev, g++, python3-scipy")
string(CONCAT CPACK_COMPONENT_LIB_DESCRIPTION
  "The C library that a robot's program links. It keeps a particle posterior over\n"
  " the parameters of a model, plans over it, and guards every command.")
string(CONCAT CPACK_COMPONENT_DEV_DESCRIPTION
  "The C ABI, the headers for models of one's own, the static libraries of each\n"
  " part, the CMake package and the pkg-config file.")
string(CONCAT CPACK_COMPONENT_TOOLS_DESCRIPTION
  "The command runs robots, simulates plants, records and replays logs, learns\n"
  " parameters and finds what a model lacks. Models of one's own in C++ need g++\n"
  " and libtiller-dev.")
include(CPack)
