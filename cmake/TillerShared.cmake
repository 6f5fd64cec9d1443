# libtiller.so (-DTILLER_SHARED=ON): the C ABI for programs that link it, in whatever language.
# While the first number is 0, the second changes what programs see: both are in the library's name.
set(TILLER_SONAME ${PROJECT_VERSION_MAJOR})
if(PROJECT_VERSION_MAJOR EQUAL 0)
  set(TILLER_SONAME ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
endif()

# The shared library is every archive of the core, whole, with the C ABI alone to be seen.
set(core "")
foreach(part IN LISTS core_targets)
  get_target_property(type ${part} TYPE)
  if(type STREQUAL "STATIC_LIBRARY")
    list(APPEND core ${part})
  endif()
endforeach()
file(WRITE ${PROJECT_BINARY_DIR}/generated/libtiller.c "typedef int tiller_the_archives_hold_everything;\n")
# Seen from outside: the functions that the C headers declare.
file(GLOB headers ${PROJECT_SOURCE_DIR}/runtime/include/tiller/*.h)
set(seen "")
foreach(header IN LISTS headers)
  file(STRINGS ${header} lines REGEX "^[a-z].*tiller_[a-z0-9_]+\\(")
  foreach(line IN LISTS lines)
    string(REGEX MATCH "(tiller_[a-z0-9_]+)\\(" unused "${line}")
    string(APPEND seen "${CMAKE_MATCH_1}; ")
  endforeach()
endforeach()
file(WRITE ${PROJECT_BINARY_DIR}/generated/libtiller.map "{ global: ${seen} local: *; };\n")
add_library(tiller_shared SHARED ${PROJECT_BINARY_DIR}/generated/libtiller.c)
set_target_properties(tiller_shared PROPERTIES OUTPUT_NAME tiller VERSION ${PROJECT_VERSION}
  SOVERSION ${TILLER_SONAME} LINKER_LANGUAGE C LINK_DEPENDS ${PROJECT_BINARY_DIR}/generated/libtiller.map)
target_link_options(tiller_shared PRIVATE -Wl,--version-script=${PROJECT_BINARY_DIR}/generated/libtiller.map
  -Wl,--no-undefined)
target_link_libraries(tiller_shared PRIVATE -Wl,--whole-archive ${core} -Wl,--no-whole-archive m)
install(TARGETS tiller_shared LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT lib NAMELINK_COMPONENT dev)
