# SPDX-License-Identifier: GPL-3.0-or-later
# What nearly every file needs, precompiled once for the program and once more, with GoogleTest, for the tests.
set(ASBUILT_PCH_HEADERS <Eigen/Dense> <Eigen/Geometry> <algorithm> <array> <cmath> <functional> <map> <memory> <nlohmann/json.hpp> <optional>
    <string> <tl/expected.hpp> <unordered_map> <variant> <vector> <fmt/format.h> ${CMAKE_SOURCE_DIR}/planner/base/compiled_once.hpp)

# room(NAME SOURCES .. USES rooms.. LIBS third-party..): one static library asbuilt_NAME per room.
# USES are rooms (linked PUBLIC), LIBS are third-party targets used only in .cpp files (PRIVATE).
function(room NAME)
  cmake_parse_arguments(R "NO_PCH" "" "SOURCES;USES;LIBS;PUBLIC_LIBS" ${ARGN})
  add_library(asbuilt_${NAME} STATIC ${R_SOURCES})
  target_include_directories(asbuilt_${NAME} PUBLIC ${CMAKE_SOURCE_DIR})
  foreach(u ${R_USES})
    target_link_libraries(asbuilt_${NAME} PUBLIC asbuilt_${u})
  endforeach()
  target_link_libraries(asbuilt_${NAME} PUBLIC ${R_PUBLIC_LIBS} PRIVATE ${R_LIBS})
  if(ASBUILT_PCH AND NOT R_NO_PCH)
    target_precompile_headers(asbuilt_${NAME} REUSE_FROM asbuilt_base)
  endif()
endfunction()

# use_pch(TARGET): an executable of the program with the headers of the rooms, precompiled once.
function(use_pch TARGET)
  if(ASBUILT_PCH)
    target_precompile_headers(${TARGET} REUSE_FROM asbuilt_base)
  endif()
endfunction()

# room_test(NAME SOURCES .. USES rooms.. [LABELS ..]): one test executable test_NAME, its cases registered with CTest.
# Tests run in the source folder; tests that need ../shared/data skip with a message where it is absent.
function(room_test NAME)
  cmake_parse_arguments(T "" "TIMEOUT" "SOURCES;USES;LIBS;LABELS" ${ARGN})
  add_executable(test_${NAME} ${T_SOURCES})
  target_include_directories(test_${NAME} PRIVATE ${CMAKE_SOURCE_DIR})
  foreach(u ${T_USES})
    target_link_libraries(test_${NAME} PRIVATE asbuilt_${u})
  endforeach()
  target_link_libraries(test_${NAME} PRIVATE ${T_LIBS} GTest::gtest_main)
  if(ASBUILT_PCH AND T_USES)  # without a room there are no paths to its headers
    target_precompile_headers(test_${NAME} REUSE_FROM asbuilt_test_headers)
  endif()
  if(NOT T_LABELS)
    set(T_LABELS unit)
  endif()
  if(NOT T_TIMEOUT)
    set(T_TIMEOUT 300)
  endif()
  add_test(NAME ${NAME} COMMAND test_${NAME} WORKING_DIRECTORY ${CMAKE_SOURCE_DIR})
  set_tests_properties(${NAME} PROPERTIES LABELS "${T_LABELS}" TIMEOUT ${T_TIMEOUT})
endfunction()
