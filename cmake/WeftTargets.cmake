# One function per kind of target.

# What every target of our own is compiled with.
function(weft_configure_target target)
  target_compile_features(${target} PUBLIC cxx_std_20)
  set_target_properties(${target} PROPERTIES CXX_EXTENSIONS OFF)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wconversion)
  # GCC 12 sees overlapping copies in `"x" + std::string` (GCC bug 105651).
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
    target_compile_options(${target} PRIVATE -Wno-restrict)
  endif()
  if(WEFT_WARNINGS_AS_ERRORS)
    target_compile_options(${target} PRIVATE -Werror)
  endif()
  if(WEFT_SANITIZE)
    target_compile_options(${target} PRIVATE -fsanitize=${WEFT_SANITIZE} -fno-omit-frame-pointer
                                             -fno-sanitize-recover=all)
    target_link_options(${target} PUBLIC -fsanitize=${WEFT_SANITIZE})
  endif()
endfunction()

# A library exported as weft::NAME. Its sources are added by the folders below it.
function(weft_add_library name)
  add_library(weft-${name} STATIC)
  add_library(weft::${name} ALIAS weft-${name})
  set_target_properties(weft-${name} PROPERTIES EXPORT_NAME ${name} POSITION_INDEPENDENT_CODE ON)
  weft_configure_target(weft-${name})
endfunction()

# Kernel files that others include.
set(WEFT_KERNEL_INCLUDES ${PROJECT_SOURCE_DIR}/kernels/decode_texels.cl
                         ${PROJECT_SOURCE_DIR}/kernels/encoding.cl
                         ${PROJECT_SOURCE_DIR}/kernels/group_largest.cl
                         ${PROJECT_SOURCE_DIR}/kernels/look_up_record.cl
                         ${PROJECT_SOURCE_DIR}/kernels/micro_tile.cl
                         ${PROJECT_SOURCE_DIR}/kernels/onion_slices.cl
                         ${PROJECT_SOURCE_DIR}/kernels/surface_march.cl
                         ${PROJECT_SOURCE_DIR}/kernels/tile_texels.cl
                         ${PROJECT_SOURCE_DIR}/kernels/tile_values.cl
                         ${PROJECT_SOURCE_DIR}/kernels/vector_width.cl
                         ${PROJECT_SOURCE_DIR}/kernels/vq_books.cl)

# Embeds OpenCL C files: weft_embed_kernels(TARGET STEM ...): kernels/STEM.cl becomes
# kernel_sources::STEM.
function(weft_embed_kernels target)
  foreach(stem IN LISTS ARGN)
    set(file ${PROJECT_SOURCE_DIR}/kernels/${stem}.cl)
    set(output ${CMAKE_CURRENT_BINARY_DIR}/kernels/${stem}.cpp)
    add_custom_command(
      OUTPUT ${output}
      COMMAND ${CMAKE_COMMAND} -DINPUT=${file} -DOUTPUT=${output} -DSTEM=${stem}
              -P ${PROJECT_SOURCE_DIR}/cmake/EmbedKernel.cmake
      DEPENDS ${file} ${WEFT_KERNEL_INCLUDES} ${PROJECT_SOURCE_DIR}/cmake/EmbedKernel.cmake
              ${PROJECT_SOURCE_DIR}/cmake/TextBytes.cmake
      COMMENT "Embedding ${stem}.cl"
      VERBATIM)
    target_sources(${target} PRIVATE ${output})
  endforeach()
endfunction()

# Embeds the tuning database that comes with the program: kernels/tuning.json becomes
# shipped_tuning_text.
function(weft_embed_tuning target)
  set(file ${PROJECT_SOURCE_DIR}/kernels/tuning.json)
  set(output ${CMAKE_CURRENT_BINARY_DIR}/kernels/shipped_tuning.cpp)
  add_custom_command(
    OUTPUT ${output}
    COMMAND ${CMAKE_COMMAND} -DINPUT=${file} -DOUTPUT=${output}
            -P ${PROJECT_SOURCE_DIR}/cmake/EmbedTuning.cmake
    DEPENDS ${file} ${PROJECT_SOURCE_DIR}/cmake/EmbedTuning.cmake
            ${PROJECT_SOURCE_DIR}/cmake/TextBytes.cmake
    COMMENT "Embedding tuning.json"
    VERBATIM)
  target_sources(${target} PRIVATE ${output})
endfunction()

# Embeds presets of materials: weft_embed_presets(TARGET FOLDER NAME ...): FOLDER/NAME.json each become
# an entry of material_presets(), and are installed as they are.
function(weft_embed_presets target folder)
  list(TRANSFORM ARGN PREPEND ${folder}/ OUTPUT_VARIABLE files)
  list(TRANSFORM files APPEND .json)
  list(JOIN ARGN "," names)
  set(output ${CMAKE_CURRENT_BINARY_DIR}/presets.cpp)
  add_custom_command(
    OUTPUT ${output}
    COMMAND ${CMAKE_COMMAND} -DFOLDER=${folder} -DNAMES=${names} -DOUTPUT=${output}
            -P ${PROJECT_SOURCE_DIR}/cmake/EmbedPresets.cmake
    DEPENDS ${files} ${PROJECT_SOURCE_DIR}/cmake/EmbedPresets.cmake
            ${PROJECT_SOURCE_DIR}/cmake/TextBytes.cmake
    COMMENT "Embedding presets of materials"
    VERBATIM)
  target_sources(${target} PRIVATE ${output})
  install(FILES ${files} DESTINATION ${CMAKE_INSTALL_DATADIR}/weft/materials)
endfunction()

# Embeds text files as the std::string_views that a header declares: weft_embed_texts(TARGET NAMESPACE
# HEADER NAME=FILE[+FILE ...] ...); several files follow each other in one text.
function(weft_embed_texts target namespace header)
  set(names "")
  set(groups "")
  set(all_files "")
  foreach(entry IN LISTS ARGN)
    string(REGEX MATCH "^([a-z_]+)=(.*)$" matched ${entry})
    list(APPEND names ${CMAKE_MATCH_1})
    string(REPLACE "+" ";" files ${CMAKE_MATCH_2})
    list(TRANSFORM files PREPEND ${CMAKE_CURRENT_SOURCE_DIR}/)
    list(APPEND all_files ${files})
    list(JOIN files "|" group)
    list(APPEND groups ${group})
  endforeach()
  list(JOIN names "," names)
  list(JOIN groups "," groups)
  string(REPLACE "/" "_" output ${header})
  string(REPLACE ".hpp" ".cpp" output ${CMAKE_CURRENT_BINARY_DIR}/texts/${output})
  add_custom_command(
    OUTPUT ${output}
    COMMAND ${CMAKE_COMMAND} -DNAMES=${names} -DFILES=${groups} -DNAMESPACE=${namespace}
            -DHEADER=${header} -DOUTPUT=${output} -P ${PROJECT_SOURCE_DIR}/cmake/EmbedTexts.cmake
    DEPENDS ${all_files} ${PROJECT_SOURCE_DIR}/cmake/EmbedTexts.cmake
    COMMENT "Embedding the texts of ${header}"
    VERBATIM)
  target_sources(${target} PRIVATE ${output})
endfunction()

# A test program: weft_add_test(NAME SOURCES a.cpp ... [LABELS l ...] [TIMEOUT seconds]).
# One ctest entry per program, because a process start on an OpenCL device is not free.
function(weft_add_test name)
  cmake_parse_arguments(ARG "" "TIMEOUT" "SOURCES;LABELS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  weft_configure_target(${name})
  target_link_libraries(${name} PRIVATE weft-test-support GTest::gtest_main)
  add_test(NAME ${name} COMMAND ${name})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 900)
  endif()
  set_tests_properties(${name} PROPERTIES TIMEOUT ${ARG_TIMEOUT} LABELS "${ARG_LABELS}"
                                          ENVIRONMENT "${WEFT_TEST_ENVIRONMENT}")
endfunction()

# A run of a test program on the Oclgrind simulator: weft_add_oclgrind_test(NAME TARGET [ARGUMENT...]).
# It fails on any report: accesses out of bounds, data races, reads of uninitialised memory. Arguments
# choose small cases (--gtest_filter=*Small*); the device choice "auto" finds the simulator alone. Not
# added to builds with sanitizers, which the simulator can't run.
function(weft_add_oclgrind_test name target)
  if(WEFT_SANITIZE)
    return()
  endif()
  find_program(OCLGRIND oclgrind REQUIRED)
  add_test(NAME ${name}
           COMMAND sh ${PROJECT_SOURCE_DIR}/tests/support/run_oclgrind.sh ${OCLGRIND}
                   ${CMAKE_CURRENT_BINARY_DIR}/${name}.log $<TARGET_FILE:${target}> ${ARGN})
  set_tests_properties(${name} PROPERTIES TIMEOUT 600 LABELS oclgrind ENVIRONMENT "WEFT_TUNING=")
endfunction()
