# lcm-gen 1.3.1 of Debian 12 comes without CMake files.
find_program(LCM_GEN lcm-gen REQUIRED)
find_package(Python3 REQUIRED COMPONENTS Interpreter)
find_program(JAVAC javac)
find_program(JAR jar)
find_file(LCM_JAR lcm.jar PATHS /usr/share/java NO_DEFAULT_PATH)

# hedgehop_lcm_types(TARGET t PACKAGE p TYPES a_t.lcm ...)
#
# Interface library `t` with <p/a_t.hpp> ..., hardened by scripts/harden_lcmtypes.py, and, where a Java compiler
# and lcm.jar are found, <p>_types.jar beside them, which lcm-spy decodes with.
function(hedgehop_lcm_types)
  cmake_parse_arguments(ARG "" "TARGET;PACKAGE" "TYPES" ${ARGN})
  set(raw "${CMAKE_CURRENT_BINARY_DIR}/raw")
  set(include "${CMAKE_CURRENT_BINARY_DIR}/include")
  set(sources)
  set(headers "${include}/${ARG_PACKAGE}/all_types.hpp")
  foreach(type IN LISTS ARG_TYPES)
    cmake_path(GET type STEM name)
    list(APPEND sources "${CMAKE_CURRENT_SOURCE_DIR}/${type}")
    list(APPEND headers "${include}/${ARG_PACKAGE}/${name}.hpp")
  endforeach()
  set(scripts "${PROJECT_SOURCE_DIR}/scripts/harden_lcmtypes.py" "${PROJECT_SOURCE_DIR}/scripts/lcm_schema.py")
  set(stamp "${CMAKE_CURRENT_BINARY_DIR}/types.stamp")
  add_custom_command(
    OUTPUT "${stamp}"
    BYPRODUCTS ${headers}
    COMMAND "${CMAKE_COMMAND}" -E rm -rf "${raw}"
    COMMAND "${LCM_GEN}" -x --cpp-std c++11 --cpp-hpath "${raw}" ${sources}
    COMMAND "${CMAKE_COMMAND}" -E env PYTHONDONTWRITEBYTECODE=1
            "${Python3_EXECUTABLE}" "${PROJECT_SOURCE_DIR}/scripts/harden_lcmtypes.py"
            "${CMAKE_CURRENT_SOURCE_DIR}" "${raw}" "${include}/${ARG_PACKAGE}"
    COMMAND "${CMAKE_COMMAND}" -E touch "${stamp}"
    DEPENDS ${sources} ${scripts}
    COMMENT "Generating and hardening message types"
    VERBATIM)
  add_custom_target(${ARG_TARGET}_generate DEPENDS "${stamp}")
  add_library(${ARG_TARGET} INTERFACE)
  add_dependencies(${ARG_TARGET} ${ARG_TARGET}_generate)
  # Generated code trips the project's warnings; lcm_coretypes.h needs no library.
  target_include_directories(${ARG_TARGET} SYSTEM INTERFACE
    "$<BUILD_INTERFACE:${include};${LCM_INCLUDE_DIRS}>" "$<INSTALL_INTERFACE:include>")
  target_link_libraries(${ARG_TARGET} INTERFACE $<INSTALL_INTERFACE:PkgConfig::LCM>)
  install(DIRECTORY "${include}/${ARG_PACKAGE}" DESTINATION include COMPONENT types)
  install(FILES ${ARG_TYPES} DESTINATION "share/lcm/${ARG_PACKAGE}" COMPONENT types)

  if(JAVAC AND JAR AND LCM_JAR)
    set(java "${CMAKE_CURRENT_BINARY_DIR}/java")
    set(jar "${CMAKE_CURRENT_BINARY_DIR}/${ARG_PACKAGE}_types.jar")
    set(java_sources)
    foreach(type IN LISTS ARG_TYPES)
      cmake_path(GET type STEM name)
      list(APPEND java_sources "${java}/source/${ARG_PACKAGE}/${name}.java")
    endforeach()
    add_custom_command(
      OUTPUT "${jar}"
      COMMAND "${CMAKE_COMMAND}" -E rm -rf "${java}"
      COMMAND "${LCM_GEN}" -j --jpath "${java}/source" ${sources}
      COMMAND "${JAVAC}" -nowarn -cp "${LCM_JAR}" -d "${java}/classes" ${java_sources}
      COMMAND "${JAR}" cf "${jar}" -C "${java}/classes" .
      DEPENDS ${sources}
      COMMENT "Building ${ARG_PACKAGE}_types.jar for lcm-spy"
      VERBATIM)
    add_custom_target(${ARG_TARGET}_jar ALL DEPENDS "${jar}")
    install(FILES "${jar}" DESTINATION share/java RENAME ${ARG_PACKAGE}-types.jar COMPONENT types)
  else()
    message(STATUS "No Java compiler or no lcm.jar: no type jar for lcm-spy")
  endif()
endfunction()
