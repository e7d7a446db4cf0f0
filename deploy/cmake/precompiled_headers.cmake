# Precompiled headers: most of the compile time of this project is the parsing of the same few headers of the
# standard library, absl, GoogleTest, gRPC and protobuf. Each set is compiled once and used by many targets.
# Sources still include what they use: the structure tests and clang-tidy compile without these sets.
#
#   lumifold_precompiled(NAME [PROGRAM] HEADERS ... [LINK ...])  makes the set NAME; PROGRAM: for programs (-fPIE)
#   lumifold_use_precompiled(TARGET NAME)                        compiles TARGET with it
#   lumifold_merge_sources(TARGET)                               compiles several sources of TARGET at a time
#
# What is left with them is mostly the same templates, instantiated again in each source that has gRPC's
# headers: many times what the source itself costs. Targets with many such sources are MERGED. Names in the
# unnamed namespaces of sources compiled together must differ. Code of pictures is not merged: it is cheap,
# and an overload that a neighbour brings could change a picture.
option(LUMIFOLD_PCH "Use precompiled headers" ON)
option(LUMIFOLD_MERGE "Compile sources of MERGED targets several at a time: quicker for all, slower for one" ON)

# The options of programs that use a set.
function(lumifold_program_optimisation name result)
  if(name STREQUAL farm_test)
    set(${result} lumifold_farm_test_options PARENT_SCOPE)
  else()
    set(${result} lumifold_program_options PARENT_SCOPE)
  endif()
endfunction()

function(lumifold_precompiled name)
  cmake_parse_arguments(ARG "PROGRAM" "" "HEADERS;LINK" ${ARGN})
  if(NOT LUMIFOLD_PCH)
    return()
  endif()
  set(source ${PROJECT_BINARY_DIR}/precompiled/${name}.cc)  # CMake needs one to find the language
  file(CONFIGURE OUTPUT ${source} CONTENT "")
  add_library(precompiled_${name} OBJECT ${source})
  # ccache would take the set of the last build, which is still there, for the content of this one, and return
  # a set of headers that have changed since.
  set_target_properties(precompiled_${name} PROPERTIES
    CXX_COMPILER_LAUNCHER "${PROJECT_SOURCE_DIR}/deploy/cmake/without_old_output.sh;${CMAKE_CXX_COMPILER_LAUNCHER}")
  target_precompile_headers(precompiled_${name} PRIVATE ${ARG_HEADERS})
  target_link_libraries(precompiled_${name} PRIVATE lumifold_options ${ARG_LINK})
  if(ARG_PROGRAM)
    lumifold_program_optimisation(${name} optimisation)
    target_link_libraries(precompiled_${name} PRIVATE ${optimisation})
    # gcc takes a set only with the -fPIC or -fPIE that it was made with.
    set_target_properties(precompiled_${name} PROPERTIES POSITION_INDEPENDENT_CODE OFF)
    target_compile_options(precompiled_${name} PRIVATE -fPIE)
  endif()
endfunction()

function(lumifold_use_precompiled target name)
  if(TARGET precompiled_${name})
    target_precompile_headers(${target} REUSE_FROM precompiled_${name})
  endif()
endfunction()

function(lumifold_merge_sources target)
  if(LUMIFOLD_MERGE)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 32)
  endif()
endfunction()

set(common_headers
  <algorithm> <array> <cmath> <cstdint> <functional> <limits> <map> <memory> <optional> <set> <span> <string>
  <string_view> <utility> <vector>
  <absl/functional/function_ref.h> <absl/status/status.h> <absl/status/statusor.h> <absl/strings/str_cat.h>
  <absl/types/span.h>)
set(farm_headers
  <grpcpp/grpcpp.h> <absl/strings/str_format.h> <absl/synchronization/mutex.h> <absl/time/time.h>
  <lumifold/v1/farm.pb.h> <lumifold/v1/worker.pb.h>)
# gcc instantiates the templates that the inline functions of a set name again in every source: those of the
# stubs take half a second, so that only the tests, most of which use stubs, have them.
set(stub_headers <lumifold/v1/farm.grpc.pb.h> <lumifold/v1/worker.grpc.pb.h>)
