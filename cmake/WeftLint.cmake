# Style: `lint` runs clang-format and clang-tidy over all files, the test of the same label clang-format
# alone, since clang-tidy takes minutes.
find_program(CLANG_FORMAT clang-format REQUIRED)
add_custom_target(lint
  COMMAND sh ${PROJECT_SOURCE_DIR}/tools/lint.sh ${PROJECT_BINARY_DIR}
  USES_TERMINAL VERBATIM)
add_test(NAME lint_format COMMAND sh ${PROJECT_SOURCE_DIR}/tools/lint.sh --format)
set_tests_properties(lint_format PROPERTIES LABELS lint)
