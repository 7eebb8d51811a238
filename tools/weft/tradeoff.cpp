// weft tradeoff: measures a grid of codecs and parameters over materials (tradeoff/), and writes
// results.json, results.csv and index.html into a folder. A stopped run goes on where it was.
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common.hpp"
#include "report.hpp"
#include "subcommand.hpp"
#include "tradeoff/grid.hpp"
#include "tradeoff/measure_point.hpp"
#include "tradeoff/page.hpp"
#include "tradeoff/results.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/error.hpp"
#include "weft/version.hpp"

namespace weft {
namespace {

constexpr int unmet_goal = static_cast<int>(ErrorKind::unmet_goal);

struct TradeoffOptions {
  std::vector<std::string> inputs;
  std::string output;
  std::string grid;
  std::vector<std::string> points;
  std::vector<std::string> codecs;
  std::vector<std::string> targets;
  std::string with;
  bool print_grid = false;
  bool restart = false;
  bool no_pictures = false;
  MeasureSettings measure;
  OutputOptions report;
};

// Keeps a second run out of the folder for as long as it lives.
class FolderLock {
 public:
  explicit FolderLock(const std::filesystem::path& folder)
      : descriptor_(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
    if (descriptor_ >= 0 && ::flock(descriptor_, LOCK_EX | LOCK_NB) == 0) return;
    if (descriptor_ >= 0) ::close(descriptor_);
    fail_input("--output: '{}' is in use by another run, or can't be opened", folder.string());
  }
  ~FolderLock() { ::close(descriptor_); }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int descriptor_;
};

// Removes what a run needs only while it works, also what one that was killed has left.
class WorkFolder {
 public:
  explicit WorkFolder(std::filesystem::path path) : path_(std::move(path)) { remove(); }
  ~WorkFolder() { remove(); }
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;

 private:
  void remove() const {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  std::filesystem::path path_;
};

std::vector<std::string> codec_names(const TradeoffOptions& options) {
  if (!options.codecs.empty()) return options.codecs;
  std::vector<std::string> names;
  for (const Codec* codec : codecs()) names.emplace_back(codec->name());
  return names;
}

// What is asked for, checked: --grid, --point and --targets add up; without any, the default grid.
std::vector<TradeoffPoint> wanted_points(const TradeoffOptions& options) {
  for (const std::string& name : options.codecs) {
    if (name != "auto") find_codec(name);
  }
  std::vector<TradeoffPoint> points;
  const auto add = [&points](std::vector<TradeoffPoint> some) {
    for (TradeoffPoint& point : some) {
      if (std::ranges::find(points, point) == points.end()) points.push_back(std::move(point));
    }
  };
  if (!options.grid.empty()) add(read_grid(options.grid));
  const bool own = !options.grid.empty() || !options.points.empty() || !options.targets.empty();
  if (!own) add(parse_grid(default_grid_text(), "default grid"));
  if (!options.codecs.empty()) {
    std::erase_if(points, [&](const TradeoffPoint& point) {
      return std::ranges::find(options.codecs, point.codec) == options.codecs.end();
    });
  }
  for (const std::string& text : options.points) add({parse_point(text, "--point")});
  for (const std::string& codec : codec_names(options)) {
    for (const std::string& target : options.targets) add({{codec, {"--target", target}}});
  }
  if (points.empty()) fail_input("--codecs: the grid has no point of these codecs");
  const std::vector<std::string> with = split_words(options.with, "--with");
  for (TradeoffPoint& point : points) {
    point.options.insert(point.options.end(), with.begin(), with.end());
    check_point(point);
  }
  return points;
}

// A material is called what its file is, or its whole path where that is taken.
std::string name_for(const std::string& path, const std::vector<TradeoffMaterial>& others) {
  const std::string stem = std::filesystem::path(path).stem().string();
  const bool taken = std::ranges::any_of(others, [&](const TradeoffMaterial& other) {
    return other.name == stem && other.path != path;
  });
  return taken ? path : stem;
}

void say(const TradeoffOptions& options, const std::string& line) {
  if (!options.report.quiet) fmt::print(stderr, "{}\n", line);
}

// A run: what is known from earlier ones, and what is added to it.
class TradeoffRun {
 public:
  explicit TradeoffRun(const TradeoffOptions& options)
      : options_(options), folder_(options.measure.folder), record_(folder_ / "results.json") {
    if (!options.restart) results_ = load_results(record_);
    const std::string now = version();
    if (!results_.points.empty() && results_.program_version != now) {
      say(options_, fmt::format("{}: measured by version {}; all is measured again",
                                record_.string(), results_.program_version));
      results_ = {};
    }
    results_.program_version = now;
  }

  // The materials of the inputs, also those known; what has changed under its name is forgotten.
  void add_materials() {
    std::vector<TradeoffMaterial> inputs;
    for (const std::string& path : options_.inputs) {
      TradeoffMaterial material = describe_material(path, name_for(path, inputs));
      for (const TradeoffMaterial& other : inputs) {
        if (other.checksum == material.checksum) {
          fail_input("{} and {} hold the same bytes", other.path, path);
        }
      }
      inputs.push_back(std::move(material));
    }
    for (TradeoffMaterial& material : inputs) {
      forget_if_changed(material);
      const auto known =
          std::ranges::find(results_.materials, material.checksum, &TradeoffMaterial::checksum);
      if (known == results_.materials.end()) {
        material.name = name_for(material.path, results_.materials);
        results_.materials.push_back(material);
      } else {
        known->path = material.path;  // it may have been moved
      }
      checksums_.push_back(material.checksum);
    }
  }

  void measure(const std::vector<TradeoffPoint>& points) {
    const auto start = std::chrono::steady_clock::now();
    const std::size_t total = checksums_.size() * points.size();
    std::size_t done = 0;
    for (const std::string& checksum : checksums_) {
      const auto material =
          std::ranges::find(results_.materials, checksum, &TradeoffMaterial::checksum);
      if (options_.measure.pictures) {
        const std::string message = draw_material(*material, options_.measure);
        if (!message.empty()) say(options_, fmt::format("{}: {}", material->name, message));
      }
      for (const TradeoffPoint& point : points) {
        ++done;
        const MeasuredPoint* const known = results_.find(key_of(*material, point));
        if (known && known->settled() && complete(*known)) {
          ++reused_;
          keys_.push_back(known->key);
          continue;
        }
        MeasuredPoint result = measure_point(*material, point, options_.measure, results_.device);
        keys_.push_back(result.key);
        ++measured_;
        const double seconds =
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        tell(result, done, total, seconds);
        results_.put(std::move(result));
        save_results(record_, results_);
      }
    }
  }

  void write_files() const {
    save_results(record_, results_);
    save_csv(folder_ / "results.csv", results_);
    save_text(folder_ / "index.html", make_page(folder_, results_));
  }

  // Says what this run was asked for. Points that failed for other reasons than a goal that can't
  // be met make the exit status 1.
  void report() const {
    std::size_t unmet = 0, failed = 0;
    std::vector<std::vector<Cell>> rows;
    for (const std::string& key : keys_) {
      const MeasuredPoint& point = *results_.find(key);
      if (point.status == unmet_goal) ++unmet;
      if (point.status != 0 && point.status != unmet_goal) ++failed;
      rows.push_back(row_of(point));
    }
    Report report;
    report.add("folder", folder_.string());
    report.add("page", (folder_ / "index.html").string());
    report.add("materials", checksums_.size()).add("points", keys_.size());
    report.add("measured", measured_).add("known_before", reused_);
    report.add("unmet_goals", unmet).add("failed", failed);
    report.table("table",
                 {"material", "point", "status", "file_size", "ratio", "psnr", "ssim",
                  "encode_time", "image_rate", "lookup_rate", "peak_memory"},
                 std::move(rows));
    report.print(options_.report);
    if (failed > 0) {
      fail(ErrorKind::unmet_goal, "{} of {} points failed; {} has their messages", failed,
           keys_.size(), record_.string());
    }
  }

 private:
  void forget_if_changed(const TradeoffMaterial& material) {
    const auto known =
        std::ranges::find(results_.materials, material.path, &TradeoffMaterial::path);
    if (known == results_.materials.end() || known->checksum == material.checksum) return;
    const std::string name = known->name;
    const auto gone = std::erase_if(
        results_.points, [&](const MeasuredPoint& point) { return point.material == name; });
    results_.materials.erase(known);
    say(options_, fmt::format("{}: has changed since; its {} points are measured again",
                              material.path, gone));
  }

  // Whether nothing is missing that this run is to have.
  bool complete(const MeasuredPoint& point) const {
    if (point.status != 0 || !options_.measure.keep_models) return true;
    return std::filesystem::exists(kept_model(folder_, point));
  }

  void tell(const MeasuredPoint& point, std::size_t done, std::size_t total, double seconds) const {
    if (options_.report.quiet) return;
    std::string line =
        fmt::format("{}/{} {}: {}: ", done, total, point.material, text_of(point.point));
    if (point.status == 0) {
      const auto figure = [&](std::string_view name) {
        const auto at = point.figures.find(name);
        return at == point.figures.end() ? 0.0 : at->second;
      };
      line += fmt::format("{}, {:.2f} dB, {}",
                          format_bytes(static_cast<std::uint64_t>(figure("file_size"))),
                          figure("psnr"), format_seconds(figure("encode_time")));
    } else {
      line += point.message;
    }
    // what was known before takes no time
    const double each = seconds / static_cast<double>(measured_);
    if (done < total) {
      line += fmt::format("; at most {} left",
                          format_seconds(each * static_cast<double>(total - done)));
    }
    fmt::print(stderr, "{}\n", line);
  }

  static std::vector<Cell> row_of(const MeasuredPoint& point) {
    const auto number = [&](std::string_view name, auto cell) {
      const auto at = point.figures.find(name);
      return at == point.figures.end() ? Cell{"", "null", true} : cell(at->second);
    };
    const auto plain = [](double value) { return number_cell(value); };
    const auto bytes = [](double value) {
      const auto count = static_cast<std::uint64_t>(value);
      return Cell{format_bytes(count), std::to_string(count), true};
    };
    return {text_cell(point.material),
            text_cell(text_of(point.point)),
            count_cell(static_cast<std::uint64_t>(point.status)),
            number("file_size", bytes),
            number("ratio", plain),
            number("psnr", plain),
            number("ssim", plain),
            number("encode_time", plain),
            number("image_rate", plain),
            number("lookup_rate", plain),
            number("peak_memory", bytes)};
  }

  const TradeoffOptions& options_;
  std::filesystem::path folder_;
  std::filesystem::path record_;
  TradeoffResults results_;
  std::vector<std::string> checksums_;  // of the inputs, in their order
  std::vector<std::string> keys_;       // of the points asked for
  std::size_t measured_ = 0, reused_ = 0;
};

void print_grid() {
  const std::string_view text = default_grid_text();
  const bool written = std::fwrite(text.data(), 1, text.size(), stdout) == text.size();
  if (!written || std::fflush(stdout) != 0) fail_runtime("standard output can't be written");
}

void run_tradeoff(const TradeoffOptions& given) {
  if (given.print_grid) return print_grid();
  if (given.inputs.empty()) fail_input("INPUT is required");
  if (given.output.empty()) fail_input("--output is required");
  TradeoffOptions options = given;
  const std::vector<TradeoffPoint> points = wanted_points(options);
  if (std::filesystem::exists(options.output) && !std::filesystem::is_directory(options.output)) {
    fail_input("--output: '{}' is not a folder", options.output);
  }
  std::error_code error;
  std::filesystem::create_directories(options.output, error);
  if (error) fail_input("--output: '{}': {}", options.output, error.message());
  options.measure.folder = options.output;
  options.measure.pictures = !options.no_pictures;
  const FolderLock lock(options.output);
  const WorkFolder work(work_folder(options.output));

  TradeoffRun run(options);
  run.add_materials();
  try {
    run.measure(points);
  } catch (const Error& stopped) {
    // What there is by now can be looked at, and the next run goes on from it.
    if (stopped.kind() == ErrorKind::interrupted) run.write_files();
    throw;
  }
  run.write_files();
  run.report();
}

}  // namespace

void add_tradeoff(CLI::App& program, Action& action) {
  auto options = std::make_shared<TradeoffOptions>();
  CLI::App* command = program.add_subcommand(
      "tradeoff", "Measure codecs and parameters over materials: a table and a page of plots");
  command
      ->add_option("INPUT", options->inputs,
                   "Raw BTFs: .safetensors, or .npy with a .json of directions beside it")
      ->type_name("")
      ->default_str("");
  command
      ->add_option("-o,--output", options->output,
                   "Folder for results.json, results.csv and index.html; what is in it already is "
                   "not measured again")
      ->type_name("FOLDER")
      ->default_str("");
  const auto points = [](CLI::Option* option) { return option->group("Points"); };
  points(command->add_option("--grid", options->grid,
                             "Points to measure instead of the default ones; --print-grid shows "
                             "the form"))
      ->type_name("FILE.json")
      ->default_str("");
  points(command->add_option("--point", options->points,
                             "A point: a codec and options of 'weft compress' as one text; may be "
                             "repeated"))
      ->type_name("TEXT")
      ->take_all()
      ->allow_extra_args(false)
      ->default_str("");
  points(command->add_option("--targets", options->targets,
                             "Goals, each for every codec: ratio=100,rel=0.1"))
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("KIND=VALUE,...")
      ->default_str("");
  points(command->add_option("--codecs", options->codecs, "Only points of these codecs"))
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("NAME,...")
      ->default_str("");
  points(
      command->add_option("--with", options->with,
                          "Options of 'weft compress' that every point has besides, as one text"))
      ->type_name("TEXT")
      ->default_str("");
  points(command->add_flag("--print-grid", options->print_grid,
                           "Only print the default grid, to be copied and edited"));
  const auto run = [](CLI::Option* option) { return option->group("Run"); };
  run(command->add_option("--repeat", options->measure.repeat,
                          "Runs of each encoding, of which the fastest counts; none begins after "
                          "10 s"))
      ->check(CLI::Range(1, 100))
      ->type_name("COUNT");
  run(command->add_option("--lookups", options->measure.lookups, "Random texels that are timed"))
      ->check(CLI::Range(1, 100'000'000))
      ->type_name("COUNT");
  run(command->add_option("--time-limit", options->measure.time_limit,
                          "Stop whatever takes longer, in seconds, and go on with the next point; "
                          "0: never"))
      ->check(CLI::Range(0.0, 1e7))
      ->type_name("SECONDS");
  run(command->add_flag("--keep-models", options->measure.keep_models,
                        "Keep the models, in FOLDER/models"));
  run(command->add_flag("--no-pictures", options->no_pictures, "Do without images and spheres"));
  run(command->add_flag("--restart", options->restart, "Measure again what is known"));
  add_output_options(*command, options->report);
  command->footer(
      "Every point is measured by processes of its own, so that one that fails loses nothing but\n"
      "itself: errors of the model as stored; the time of encoding; on the device, images decoded "
      "in\n"
      "bulk and random texels looked up per second; memory resident at the peak of encoding, with\n"
      "the OpenCL driver's and mapped pages of the input. A goal that can't be met is a result, "
      "and "
      "says\n"
      "what was reached; exit status 1 if a point fails for another reason. A stopped run goes on "
      "where\n"
      "it was; an input that has changed is measured again. Points of earlier runs stay on the "
      "page,\n"
      "one file that needs no network.\n"
      "\n"
      "Examples:\n"
      "  weft tradeoff cloth.safetensors leather.safetensors -o tradeoff\n"
      "  weft tradeoff cloth.safetensors --codecs pca,tt -o tradeoff\n"
      "  weft tradeoff cloth.safetensors --point 'pca --rank 24' --point 'tt --target rel=0.1' -o "
      "own\n"
      "  weft tradeoff cloth.safetensors --targets ratio=50,ratio=200 --with '--storage f32' -o "
      "goals\n"
      "  weft tradeoff --print-grid > grid.json\n"
      "  weft tradeoff cloth.safetensors --grid grid.json --time-limit 60 -o tradeoff");
  command->callback([options, &action] { action = [options] { run_tradeoff(*options); }; });
}

}  // namespace weft
