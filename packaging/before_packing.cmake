# Run by cpack on what it is about to pack: CMake strips programs, but neither static libraries nor the Python module.
file(GLOB_RECURSE archives "${CPACK_TEMPORARY_DIRECTORY}/*.a")
if(archives)
  execute_process(COMMAND strip --strip-debug --enable-deterministic-archives ${archives} COMMAND_ERROR_IS_FATAL ANY)
endif()
file(GLOB_RECURSE modules "${CPACK_TEMPORARY_DIRECTORY}/*.so")
if(modules)
  execute_process(COMMAND strip --strip-unneeded ${modules} COMMAND_ERROR_IS_FATAL ANY)
endif()
