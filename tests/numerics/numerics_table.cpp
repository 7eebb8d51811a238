// Prints what the numerical-stability suite measures:
//
//   weft_numerics              a Markdown table of errors: every case, path and arithmetic
//   weft_numerics CASE ...     only these cases
//   weft_numerics --csv        as CSV
//   weft_numerics --cases      what the matrices are
//   weft_numerics --spectrum   CSV of true and computed singular values of the graded case
#include <fmt/core.h>

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "numerics/errors.hpp"
#include "weft/error.hpp"

namespace weft::numerics {
namespace {

constexpr std::array methods{SvdMethod::gram, SvdMethod::randomized, SvdMethod::qr};
constexpr std::array arithmetics{Arithmetic::f32, Arithmetic::f64};

// Two digits, and short: "3.1e-8", "0".
std::string cell(double value) {
  if (value == 0) return "0";
  if (value == 1) return "1";
  return fmt::format("{:.1e}", value);
}

void print_errors(Device& device, const std::vector<std::string>& names, bool csv) {
  const char* row =
      csv ? "{},{},{},{},{},{},{},{},{}\n" : "| {} | {} | {} | {} | {} | {} | {} | {} | {} |\n";
  fmt::print(fmt::runtime(row), "case", "arithmetic", "path", "found", "value", "relative",
             "resolved", "subspace", "reconstruction");
  if (!csv) fmt::print("|---|---|---|--:|--:|--:|--:|--:|--:|\n");
  for (const std::string& name : names) {
    const Case& what = find_case(name);
    for (const Arithmetic arithmetic : arithmetics) {
      if (arithmetic == Arithmetic::f64 && !device.limits().has_fp64) continue;
      const Matrix matrix = what.make(arithmetic);
      const ReferenceSvd truth = reference_svd(matrix, what.period);
      for (const SvdMethod method : methods) {
        const Computed computed = factorise(device, matrix, what.rank, method, arithmetic);
        const Errors errors = compare(what, matrix, truth, computed);
        fmt::print(fmt::runtime(row), what.name, name_of(arithmetic), name_of(method),
                   fmt::format("{} of {}", errors.rank, what.rank), cell(errors.value),
                   cell(errors.relative), cell(errors.resolved),
                   what.leading > 0 ? cell(errors.subspace) : "-", cell(errors.reconstruction));
      }
    }
  }
}

void print_cases() {
  fmt::print("| case | matrix |\n|---|---|\n");
  for (const Case& what : cases()) fmt::print("| {} | {} |\n", what.name, what.what);
}

// One line per arithmetic and singular value: of the matrix as it is rounded to the arithmetic, and
// what each path computes; empty where it was given up.
void print_spectrum(Device& device) {
  const Case& what = find_case("graded");
  fmt::print("arithmetic,j,true");
  for (const SvdMethod method : methods) fmt::print(",{}", name_of(method));
  fmt::print("\n");
  for (const Arithmetic arithmetic : arithmetics) {
    if (arithmetic == Arithmetic::f64 && !device.limits().has_fp64) continue;
    const Matrix matrix = what.make(arithmetic);
    const ReferenceSvd truth = reference_svd(matrix, what.period);
    std::vector<Computed> columns;
    for (const SvdMethod method : methods) {
      columns.push_back(factorise(device, matrix, what.rank, method, arithmetic));
    }
    for (std::size_t j = 0; j < what.rank; ++j) {
      fmt::print("{},{},{:.16e}", name_of(arithmetic), j + 1,
                 std::ldexp(truth.values[j], -truth.exponent));
      for (const Computed& computed : columns) {
        fmt::print(",{}", j < computed.rank ? fmt::format("{:.16e}", std::ldexp(computed.values[j],
                                                                                -computed.exponent))
                                            : "");
      }
      fmt::print("\n");
    }
  }
}

void run(int count, char** arguments) {
  bool csv = false;
  bool spectrum = false;
  std::vector<std::string> names;
  for (int i = 1; i < count; ++i) {
    const std::string argument = arguments[i];
    if (argument == "--csv") {
      csv = true;
    } else if (argument == "--cases") {
      return print_cases();
    } else if (argument == "--spectrum") {
      spectrum = true;
    } else {
      names.push_back(find_case(argument).name);
    }
  }
  Device device("auto");
  if (spectrum) return print_spectrum(device);
  if (names.empty()) {
    for (const Case& what : cases()) names.push_back(what.name);
  }
  print_errors(device, names, csv);
}

}  // namespace
}  // namespace weft::numerics

int main(int count, char** arguments) {
  try {
    weft::numerics::run(count, arguments);
    return 0;
  } catch (const weft::Error& error) {
    fmt::print(stderr, "weft_numerics: {}\n", error.what());
    return static_cast<int>(error.kind());
  }
}
