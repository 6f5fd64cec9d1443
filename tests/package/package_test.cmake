# See CMakeLists.txt. Runs as cmake -P; the first command that fails ends the test with its output.
function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE code OUTPUT_VARIABLE out ERROR_VARIABLE out)
  if(NOT code EQUAL 0)
    list(JOIN ARGN " " line)
    message(FATAL_ERROR "failed (${code}): ${line}\n${out}")
  endif()
  set(out "${out}" PARENT_SCOPE)
endfunction()

file(REMOVE_RECURSE ${WORK}/installed ${WORK}/prefix ${WORK}/consumer)
run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/installed)
# A tree that has moved must work: nothing in it may hold the path of its installation.
file(RENAME ${WORK}/installed ${WORK}/prefix)

set(flags "")
if(SANITIZE)
  set(flags "-fsanitize=${SANITIZE}")
endif()
run(${CMAKE_COMMAND} -S ${CONSUMER} -B ${WORK}/consumer -G ${GENERATOR}
  -D CMAKE_PREFIX_PATH=${WORK}/prefix -D CMAKE_C_FLAGS=${flags} -D CMAKE_CXX_FLAGS=${flags}
  -D CMAKE_FIND_PACKAGE_NO_PACKAGE_REGISTRY=ON)
run(${CMAKE_COMMAND} --build ${WORK}/consumer)

foreach(language IN ITEMS c cpp)
  run(${WORK}/consumer/consumer_${language})
  message("${out}")
  if(NOT out MATCHES "tiller ${VERSION}")
    message(FATAL_ERROR "consumer_${language} does not name version ${VERSION}")
  endif()
endforeach()

if(COMMAND_BUILT)
  run(${WORK}/prefix/bin/tiller --help)
  if(NOT out MATCHES "identify")
    message(FATAL_ERROR "the installed command's help does not name its subcommands:\n${out}")
  endif()
  if(SANITIZE)
    message("exported configurations are not linked: the head's commands know nothing of sanitizers")
  else()
    run(sh ${EXPORT_TEST} ${WORK}/prefix ${WORK}/exported ${SOURCE})
    message("${out}")
  endif()
endif()
