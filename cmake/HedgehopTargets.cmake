# Flags, the room function and the test function of the project.

add_library(hedgehop_flags INTERFACE)
# Same bytes on every machine: no contraction into fused operations, no -ffast-math, a fixed baseline.
target_compile_options(hedgehop_flags INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -ffp-contract=off)
# The rooms become part of the Python module too. Position-independent code at the speed of the other: nothing of ours is
# replaced at run time.
target_compile_options(hedgehop_flags INTERFACE
  $<$<BOOL:$<TARGET_PROPERTY:POSITION_INDEPENDENT_CODE>>:-fno-semantic-interposition>)
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  target_compile_options(hedgehop_flags INTERFACE -march=x86-64-v2)
endif()
if(HEDGEHOP_WERROR)
  target_compile_options(hedgehop_flags INTERFACE -Werror)
endif()
if(HEDGEHOP_SANITIZE)
  target_compile_options(hedgehop_flags INTERFACE
    -fsanitize=${HEDGEHOP_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer)
  target_link_options(hedgehop_flags INTERFACE -fsanitize=${HEDGEHOP_SANITIZE})
endif()
if(HEDGEHOP_TIDY)
  find_program(CLANG_TIDY clang-tidy REQUIRED)
  set(CMAKE_CXX_CLANG_TIDY "${CLANG_TIDY};--warnings-as-errors=*;--quiet")
endif()

include(GNUInstallDirs)

# hedgehop_library(NAME room SOURCES a.cpp HEADERS a.hpp DEPENDS hedgehop::base PRIVATE_DEPENDS GDAL::GDAL)
#
# One static library for one room, `hedgehop::<room>`. DEPENDS are rooms that its headers or sources
# use; PRIVATE_DEPENDS are third-party libraries, which stay hidden in the .cpp files.
# Each header is compiled alone: by its own source, which begins with it (scripts/check_layers.py holds
# that), or else as part of the build of the tests.
function(hedgehop_library)
  cmake_parse_arguments(ARG "" "NAME" "SOURCES;HEADERS;DEPENDS;PRIVATE_DEPENDS" ${ARGN})
  set(target hedgehop_${ARG_NAME})
  if(ARG_SOURCES)
    add_library(${target} STATIC ${ARG_SOURCES})
    set_target_properties(${target} PROPERTIES POSITION_INDEPENDENT_CODE ON)
    target_include_directories(${target} PUBLIC
      "$<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/common>" "$<INSTALL_INTERFACE:include/hedgehop>")
    target_link_libraries(${target}
      PUBLIC ${ARG_DEPENDS} PRIVATE $<BUILD_INTERFACE:hedgehop_flags> ${ARG_PRIVATE_DEPENDS})
  else()
    add_library(${target} INTERFACE)
    target_include_directories(${target} INTERFACE
      "$<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/common>" "$<INSTALL_INTERFACE:include/hedgehop>")
    target_link_libraries(${target} INTERFACE ${ARG_DEPENDS})
  endif()
  add_library(hedgehop::${ARG_NAME} ALIAS ${target})
  hedgehop_install_library(${ARG_NAME} "${ARG_HEADERS}")
  set(sourceless)
  foreach(header IN LISTS ARG_HEADERS)
    string(REGEX REPLACE "\\.hpp$" ".cpp" source "${header}")
    if(NOT source IN_LIST ARG_SOURCES)
      list(APPEND sourceless "${header}")
    endif()
  endforeach()
  if(HEDGEHOP_TESTS AND sourceless)
    hedgehop_check_headers(${target} ${sourceless})
  endif()
endfunction()

# The room as part of the installed libraries: hedgehop::<room> for find_package(Hedgehop).
function(hedgehop_install_library name headers)
  set_target_properties(hedgehop_${name} PROPERTIES EXPORT_NAME ${name})
  target_compile_features(hedgehop_${name} PUBLIC cxx_std_20)
  install(TARGETS hedgehop_${name} EXPORT HedgehopTargets
    ARCHIVE DESTINATION "${CMAKE_INSTALL_LIBDIR}" COMPONENT development)
  install(FILES ${headers} DESTINATION "include/hedgehop/${name}" COMPONENT development)
  set_property(GLOBAL APPEND PROPERTY HEDGEHOP_INSTALLED_ROOMS ${name})
  list(TRANSFORM headers PREPEND "${CMAKE_CURRENT_SOURCE_DIR}/")
  set_property(GLOBAL APPEND PROPERTY HEDGEHOP_PUBLIC_HEADERS ${headers})
endfunction()

# Compiles each header on its own, so that no header leans on what was included before it.
function(hedgehop_check_headers target)
  set(units)
  foreach(header IN LISTS ARGN)
    string(MAKE_C_IDENTIFIER "${header}" id)
    set(unit "${CMAKE_CURRENT_BINARY_DIR}/header_check/${id}.cpp")
    file(CONFIGURE OUTPUT "${unit}" CONTENT "#include \"${CMAKE_CURRENT_SOURCE_DIR}/${header}\"\n" @ONLY)
    list(APPEND units "${unit}")
  endforeach()
  add_library(${target}_header_check OBJECT ${units})
  set_target_properties(${target}_header_check PROPERTIES CXX_CLANG_TIDY "")
  target_link_libraries(${target}_header_check PRIVATE ${target} hedgehop_flags)
endfunction()

# hedgehop_test(NAME room SOURCES a_test.cpp DEPENDS hedgehop::room LABELS unit [TIMEOUT s])
# One test program of a room; each case is a test of its own for ctest. Runs in the source tree's root.
function(hedgehop_test)
  if(NOT HEDGEHOP_TESTS)
    return()
  endif()
  cmake_parse_arguments(ARG "" "NAME;TIMEOUT" "SOURCES;DEPENDS;LABELS" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  if(NOT ARG_LABELS)
    set(ARG_LABELS unit)
  endif()
  add_executable(${ARG_NAME}_test ${ARG_SOURCES})
  if(unit IN_LIST ARG_LABELS)
    if(NOT TARGET unit_tests)
      add_custom_target(unit_tests)  # all that the label unit needs, and no more
    endif()
    add_dependencies(unit_tests ${ARG_NAME}_test)
  endif()
  target_include_directories(${ARG_NAME}_test PRIVATE "${PROJECT_SOURCE_DIR}/tests")
  # What tests say is compiled once and run once: optimising it takes longer than it saves.
  if(HEDGEHOP_SANITIZE)
    target_compile_options(${ARG_NAME}_test PRIVATE -O0)
  else()
    target_compile_options(${ARG_NAME}_test PRIVATE -O1)
  endif()
  target_link_libraries(${ARG_NAME}_test PRIVATE
    hedgehop_flags ${ARG_DEPENDS} GTest::gtest GTest::gmock GTest::gtest_main)
  gtest_discover_tests(${ARG_NAME}_test
    WORKING_DIRECTORY "${PROJECT_SOURCE_DIR}"
    TEST_PREFIX "${ARG_NAME}."
    DISCOVERY_MODE PRE_TEST
    DISCOVERY_TIMEOUT 60
    PROPERTIES LABELS "${ARG_LABELS}" TIMEOUT ${ARG_TIMEOUT})
endfunction()
