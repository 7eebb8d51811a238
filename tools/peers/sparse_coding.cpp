// weft_peers_omp: orthogonal matching pursuit beside a plain C++ implementation with OpenMP, which
// takes its correlations from OpenBLAS; interleaved, in one run.
#include <cblas.h>
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <functional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "bench/measure.hpp"
#include "common.hpp"
#include "job_report.hpp"
#include "plain_batch_omp.hpp"
#include "report.hpp"
#include "weft/error.hpp"
#include "weft/ops/batch_omp.hpp"
#include "weft/reference/random.hpp"

namespace weft::peers {
namespace {

struct Options {
  std::size_t signals = 100000;
  std::size_t atoms = 256;
  std::size_t dimension = 300;
  std::vector<std::size_t> sparsities{5, 10, 16};
  std::size_t rounds = 5;
  double pause = 0.3;
  DeviceOptions device;
  OutputOptions report;
};

using Seconds = std::chrono::duration<double>;

// A run shorter than this is preceded by one that is not timed, which wakes threads and fills
// caches.
constexpr double short_run = 0.25;

double timed(const std::function<void()>& run, double last) {
  if (last < short_run) run();
  const auto start = std::chrono::steady_clock::now();
  run();
  return Seconds(std::chrono::steady_clock::now() - start).count();
}

// Random unit atoms and random signals; unit atoms have the same correlations for both.
struct Data {
  explicit Data(const Options& options)
      : D(options.atoms * options.dimension),
        Y(options.signals * options.dimension),
        G(options.atoms * options.atoms),
        alpha(options.signals * options.atoms) {
    reference::fill_random(1, D);
    reference::fill_random(2, Y);
    for (std::size_t n = 0; n < options.atoms; ++n) {
      float* atom = D.data() + n * options.dimension;
      double square = 0;
      for (std::size_t i = 0; i < options.dimension; ++i) square += double{atom[i]} * atom[i];
      for (std::size_t i = 0; i < options.dimension; ++i) {
        atom[i] = static_cast<float>(atom[i] / std::sqrt(square));
      }
    }
    product(options, options.atoms, D, G);
    product(options, options.signals, Y, alpha);
  }
  // X D^T
  void product(const Options& options, std::size_t rows, const std::vector<float>& X,
               std::vector<float>& C) const {
    const auto M = static_cast<blasint>(rows);
    const auto N = static_cast<blasint>(options.atoms);
    const auto K = static_cast<blasint>(options.dimension);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, M, N, K, 1, X.data(), K, D.data(), K, 0,
                C.data(), N);
  }

  std::vector<float> D, Y, G, alpha;
};

// Weft's own, from buffers of the device.
class Own {
 public:
  Own(Device& device, const Options& options, const Data& data, std::size_t k)
      : device_(device),
        options_(options),
        Y_(device, data.Y.size() * sizeof(float), "Y"),
        indices_(device, options.signals * k * sizeof(std::uint32_t), "indices"),
        coefficients_(device, options.signals * k * sizeof(float), "coefficients"),
        counts_(device, options.signals * sizeof(std::uint32_t), "counts"),
        omp_(device, options.atoms, options.dimension, {.target = {k, 0}}),
        C_(device, options.signals * omp_.row_of_correlations() * sizeof(float), "correlations") {
    Buffer D(device, data.D.size() * sizeof(float), "D");
    device.write(D, std::span<const float>(data.D));
    device.write(Y_, std::span<const float>(data.Y));
    omp_.set_dictionary({D, options.dimension});
    omp_.correlate(options.signals, Y(), C_);
    device.finish();
  }
  void pursue() { omp_.code_correlated(options_.signals, Y(), C_, codes()); }
  void code() { omp_.code(options_.signals, Y(), codes()); }
  std::vector<std::uint32_t> indices(std::size_t k) {
    std::vector<std::uint32_t> values(options_.signals * k);
    device_.read(indices_, std::span<std::uint32_t>(values));
    return values;
  }

 private:
  ops::ConstMatrix Y() const { return {Y_, options_.dimension}; }
  ops::OmpCodes codes() { return {indices_, coefficients_, counts_}; }

  Device& device_;
  const Options& options_;
  Buffer Y_, indices_, coefficients_, counts_;
  ops::BatchOmp omp_;
  Buffer C_;
};

struct Contest {
  std::string name;
  std::function<void()> own;
  std::function<void()> plain;
};

int compare(const Options& options) {
  const std::unique_ptr<Device> device = open_device(options.device, options.report);
  const int threads = static_cast<int>(device->limits().compute_units);
  openblas_set_num_threads(threads);
  plain_set_threads(threads);
  Data data(options);
  std::vector<std::vector<Cell>> rows;
  bool agree = true;
  for (const std::size_t k : options.sparsities) {
    Own own(*device, options, data, k);
    std::vector<std::uint32_t> indices(options.signals * k);
    std::vector<float> coefficients(options.signals * k);
    const auto pursue = [&] {
      plain_batch_omp(options.signals, options.atoms, k, data.alpha.data(), data.G.data(),
                      indices.data(), coefficients.data());
    };
    const std::vector<Contest> contests{{"pursuit", [&] { own.pursue(); }, pursue},
                                        {"product and pursuit", [&] { own.code(); },
                                         [&] {
                                           data.product(options, options.signals, data.Y,
                                                        data.alpha);
                                           pursue();
                                         }}};
    for (const Contest& contest : contests) {
      std::vector<double> own_times;
      std::vector<double> plain_times;
      double own_last = timed(contest.own, short_run);
      double plain_last = timed(contest.plain, short_run);
      for (std::size_t round = 0; round < options.rounds; ++round) {
        check_interrupt();
        std::this_thread::sleep_for(Seconds(options.pause));
        own_last = timed(contest.own, own_last);
        own_times.push_back(own_last);
        std::this_thread::sleep_for(Seconds(options.pause));
        plain_last = timed(contest.plain, plain_last);
        plain_times.push_back(plain_last);
      }
      // Of random signals, near ties decide fewer than one in a hundred.
      const std::vector<std::uint32_t> own_indices = own.indices(k);
      std::size_t same = 0;
      for (std::size_t s = 0; s < options.signals; ++s) {
        const auto first = static_cast<std::ptrdiff_t>(s * k);
        const auto end = first + static_cast<std::ptrdiff_t>(k);
        same += std::equal(own_indices.begin() + first, own_indices.begin() + end,
                           indices.begin() + first)
                    ? 1
                    : 0;
      }
      const double share = static_cast<double>(same) / static_cast<double>(options.signals);
      agree = agree && share > 0.99;
      const double own_best = *std::ranges::min_element(own_times);
      const double plain_best = *std::ranges::min_element(plain_times);
      const double thousand = static_cast<double>(options.signals) * 1e-3;
      rows.push_back({count_cell(k), text_cell(contest.name), number_cell(thousand / own_best),
                      number_cell(thousand / plain_best), number_cell(plain_best / own_best, "", 3),
                      number_cell(median(plain_times) / median(own_times), "", 3),
                      number_cell(share, "", 5)});
    }
  }
  Report report;
  report.add("device", device->limits().name);
  report.add("compute_units", device->limits().compute_units);
  report.add("signals", options.signals);
  report.add("atoms", options.atoms);
  report.add("dimension", options.dimension);
  report.table(
      "sparse_coding",
      {"k", "work", "weft_k_per_s", "plain_k_per_s", "ratio", "median_ratio", "same_atoms"},
      std::move(rows));
  add_device_fields(report, device);
  report.print(options.report);
  return agree ? 0 : static_cast<int>(ErrorKind::unmet_goal);
}

int run(int argc, char** argv) {
  Options options;
  CLI::App program(
      "Compares orthogonal matching pursuit with a plain C++ implementation of Batch-OMP by OpenMP "
      "and OpenBLAS, interleaved.",
      "weft_peers_omp");
  program.option_defaults()->always_capture_default();
  const auto sizes = CLI::Range(std::size_t{1}, std::size_t{1} << 24);
  program.add_option("--signals", options.signals, "Signals")->check(sizes)->type_name("COUNT");
  program.add_option("--atoms", options.atoms, "Atoms")->check(sizes)->type_name("COUNT");
  program.add_option("--dimension", options.dimension, "Values of a signal")
      ->check(sizes)
      ->type_name("COUNT");
  program.add_option("--k", options.sparsities, "Atoms of a signal")
      ->check(sizes)
      ->delimiter(',')
      ->type_name("COUNT,...");
  program.add_option("--rounds", options.rounds, "Turns of each")
      ->check(CLI::Range(1, 1000))
      ->type_name("COUNT");
  program.add_option("--pause", options.pause, "Pause before each turn")
      ->check(CLI::Range(0.0, 60.0))
      ->type_name("SECONDS");
  add_device_options(program, options.device);
  add_output_options(program, options.report);
  program.footer(
      "Rates are thousands of signals per second; 'ratio' is above 1 where Weft is faster. Exit\n"
      "status 1 if more than one signal in a hundred has other atoms.\n"
      "\n"
      "Examples:\n"
      "  weft_peers_omp\n"
      "  weft_peers_omp --k 5,16 --rounds 9 --json");
  try {
    program.parse(argc, argv);
    return compare(options);
  } catch (const CLI::ParseError& error) {
    const int status = program.exit(error);
    return status == 0 ? 0 : static_cast<int>(ErrorKind::input);
  } catch (const Error& error) {
    fmt::print(stderr, "weft_peers_omp: error: {}\n", error.what());
    return static_cast<int>(error.kind());
  } catch (const std::exception& error) {
    fmt::print(stderr, "weft_peers_omp: error: {}\n", error.what());
    return static_cast<int>(ErrorKind::runtime);
  }
}

}  // namespace
}  // namespace weft::peers

int main(int argc, char** argv) {
  return weft::peers::run(argc, argv);
}
