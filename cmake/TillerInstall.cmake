# The install tree. Everything follows from TILLER_RUNTIME_TARGETS: a new folder under runtime/ is
# installed and exported without an edit here.
#
#   lib/            one static library per part
#   include/tiller  the C ABI and the authoring headers
#   include/tiller/runtime/<part>   headers of the parts; with this folder on the path "<part>/file.hpp" works
#   lib/cmake/tiller  tillerConfig.cmake
#   lib/pkgconfig     tiller.pc
#
# The command, its Python package and the robot files are installed by tools/, message types by runtime/io.

include(CMakePackageConfigHelpers)
set(TILLER_CMAKE_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/tiller)

# Real name of what a link interface names: strips $<LINK_ONLY:..> and resolves aliases; "" for flags.
function(tiller_link_item item result)
  string(REGEX REPLACE "^\\$<LINK_ONLY:(.*)>$" "\\1" item "${item}")
  if(item MATCHES "[$]<" OR NOT TARGET "${item}")
    set(${result} "" PARENT_SCOPE)
    return()
  endif()
  get_target_property(alias ${item} ALIASED_TARGET)
  if(alias)
    set(item ${alias})
  endif()
  set(${result} ${item} PARENT_SCOPE)
endfunction()

# Everything a target links, transitively: our own targets into <built>, found ones into <imported>.
function(tiller_closure target built imported)
  set(ours ${target})
  set(found "")
  set(queue ${target})
  while(queue)
    list(POP_FRONT queue current)
    set(links "")
    foreach(property LINK_LIBRARIES INTERFACE_LINK_LIBRARIES)
      get_target_property(value ${current} ${property})
      if(value)
        list(APPEND links ${value})
      endif()
    endforeach()
    foreach(link IN LISTS links)
      tiller_link_item("${link}" item)
      if(NOT item)
        continue()
      endif()
      get_target_property(is_imported ${item} IMPORTED)
      if(is_imported)
        list(APPEND found ${item})
      elseif(NOT item IN_LIST ours)
        list(APPEND ours ${item})
        list(APPEND queue ${item})
      endif()
    endforeach()
  endwhile()
  list(REMOVE_DUPLICATES found)
  set(${built} ${ours} PARENT_SCOPE)
  set(${imported} ${found} PARENT_SCOPE)
endfunction()

get_property(parts GLOBAL PROPERTY TILLER_RUNTIME_TARGETS)
set(core_targets "")
set(core_imported "")
set(io_targets "")
set(io_imported "")
set(ros2_targets "")
foreach(part IN LISTS parts)
  tiller_closure(${part} built imported)
  # What needs the transports is exported apart, so that find_package(tiller) does not ask for liblcm or Cyclone DDS.
  if("tiller_ros2" IN_LIST built)
    list(APPEND ros2_targets ${built})
  elseif("tiller_io" IN_LIST built)
    list(APPEND io_targets ${built})
    list(APPEND io_imported ${imported})
  else()
    list(APPEND core_targets ${built})
    list(APPEND core_imported ${imported})
  endif()
endforeach()
list(REMOVE_DUPLICATES core_targets)
list(REMOVE_DUPLICATES io_targets)
list(REMOVE_DUPLICATES io_imported)
if(io_targets AND core_targets)
  list(REMOVE_ITEM io_targets ${core_targets})
endif()
if(ros2_targets)
  list(REMOVE_ITEM ros2_targets ${io_targets} ${core_targets})
endif()

add_library(tiller_runtime INTERFACE)
set_target_properties(tiller_runtime PROPERTIES EXPORT_NAME tiller)
add_library(tiller::tiller ALIAS tiller_runtime)
foreach(target IN LISTS core_targets)
  if(target IN_LIST parts)
    target_link_libraries(tiller_runtime INTERFACE ${target})
  endif()
endforeach()

if(NOT TILLER_INSTALL)
  return()
endif()

# A target that is not a part (an object library of a part, generated code) keeps its name in the export.
install(TARGETS tiller_runtime ${core_targets} EXPORT tillerTargets
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(EXPORT tillerTargets NAMESPACE tiller:: DESTINATION ${TILLER_CMAKE_DIR})
if(io_targets)
  install(TARGETS ${io_targets} EXPORT tillerIoTargets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(EXPORT tillerIoTargets NAMESPACE tiller:: DESTINATION ${TILLER_CMAKE_DIR})
endif()
if(ros2_targets)
  install(TARGETS ${ros2_targets} EXPORT tillerRos2Targets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(EXPORT tillerRos2Targets NAMESPACE tiller:: DESTINATION ${TILLER_CMAKE_DIR})
endif()

foreach(part IN LISTS parts)
  get_target_property(folder ${part} SOURCE_DIR)
  get_filename_component(name ${folder} NAME)
  install(DIRECTORY ${folder}/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/tiller/runtime/${name}
    FILES_MATCHING PATTERN "*.hpp" PATTERN "*.h" PATTERN "*.def" PATTERN "*.inc")
endforeach()
install(DIRECTORY ${PROJECT_SOURCE_DIR}/runtime/include/tiller DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
  FILES_MATCHING PATTERN "*.hpp" PATTERN "*.h" PATTERN "*.def")
if(NOT TILLER_PACKAGES)
  install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
endif()

# The same for programs without CMake. The libraries need nothing of C++'s own: a program in C is linked by the C
# driver.
set(TILLER_PC_LIBS "")
foreach(target IN LISTS core_targets)
  get_target_property(type ${target} TYPE)
  if(type STREQUAL "STATIC_LIBRARY")
    string(APPEND TILLER_PC_LIBS " -l${target}")
  endif()
endforeach()
file(RELATIVE_PATH TILLER_PC_UP ${CMAKE_INSTALL_FULL_LIBDIR}/pkgconfig ${CMAKE_INSTALL_PREFIX})
string(REGEX REPLACE "/$" "" TILLER_PC_UP "${TILLER_PC_UP}")
configure_file(cmake/tiller.pc.in ${PROJECT_BINARY_DIR}/tiller.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/tiller.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)

# The liblcm of a Python environment goes along: the installed command must not need the build folder. A package of the
# distribution depends on the distribution's.
if(TARGET lcm AND TARGET tiller_command AND TILLER_VENV AND NOT TILLER_PACKAGES)
  get_target_property(lcm_file lcm LOCATION)
  string(FIND "${lcm_file}" "${TILLER_VENV}/" at)
  if(at EQUAL 0)
    install(IMPORTED_RUNTIME_ARTIFACTS lcm LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR})
    file(RELATIVE_PATH up ${CMAKE_INSTALL_FULL_BINDIR} ${CMAKE_INSTALL_FULL_LIBDIR})
    set_property(TARGET tiller_command PROPERTY INSTALL_RPATH "$ORIGIN/${up}")
  endif()
endif()

# Names for tillerConfig.cmake: what the exported targets link, no more.
foreach(package IN ITEMS Eigen3::Eigen:EIGEN xsimd:XSIMD)
  string(REGEX MATCH "^(.*):([A-Z]+)$" unused ${package})
  set(TILLER_NEEDS_${CMAKE_MATCH_2} FALSE)
  if("${CMAKE_MATCH_1}" IN_LIST core_imported)
    set(TILLER_NEEDS_${CMAKE_MATCH_2} TRUE)
  endif()
endforeach()
set(TILLER_IO_IMPORTED ${io_imported})
list(FILTER TILLER_IO_IMPORTED INCLUDE REGEX "lcm")
set(TILLER_IO_PACKAGES "")
set(TILLER_IO_HINTS "")
if(TILLER_IO_IMPORTED)
  set(TILLER_IO_PACKAGES lcm)
  if(lcm_DIR)
    set(TILLER_IO_HINTS ${lcm_DIR}) # where this build found it; CMAKE_PREFIX_PATH comes first
  endif()
endif()
configure_package_config_file(cmake/tillerConfig.cmake.in ${PROJECT_BINARY_DIR}/tillerConfig.cmake
  INSTALL_DESTINATION ${TILLER_CMAKE_DIR})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/tillerConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/tillerConfig.cmake ${PROJECT_BINARY_DIR}/tillerConfigVersion.cmake
  DESTINATION ${TILLER_CMAKE_DIR})
