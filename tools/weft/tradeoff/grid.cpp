#include "tradeoff/grid.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cctype>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "subcommand.hpp"
#include "tradeoff/texts.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/error.hpp"
#include "weft/io/json_text.hpp"

namespace weft {

// Defined with its subcommand: says which options there are.
void add_compress(CLI::App& program, Action& action);

namespace {

using nlohmann::json;

// A slip in a grid of lists is quickly a billion points.
constexpr std::size_t most_points = 10000;

// One choice of an option: its words, none where it is absent.
using Choice = std::vector<std::string>;

bool is_blank(char c) {
  return std::isspace(static_cast<unsigned char>(c)) != 0;
}

// Characters that no shell gives a meaning to.
bool is_plain(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) != 0 ||
         std::string_view("-_./=,:+@%").find(c) != std::string_view::npos;
}

Choice choice_of(const std::string& name, const json& value, const std::string& where) {
  if (value.is_null() || value == false) return {};
  if (value == true) return {"--" + name};
  if (value.is_string()) return {"--" + name, value.get<std::string>()};
  if (value.is_number()) return {"--" + name, value.dump()};
  fail_input("{}: \"{}\" is neither a text nor a number, nor true, false or null", where, name);
}

std::vector<Choice> choices_of(const std::string& name, const json& value,
                               const std::string& where) {
  if (!value.is_array()) return {choice_of(name, value, where)};
  if (value.empty()) fail_input("{}: \"{}\" is an empty list", where, name);
  std::vector<Choice> choices;
  for (const json& one : value) choices.push_back(choice_of(name, one, where));
  return choices;
}

void check_names(const json& element, const std::string& where) {
  if (!element.contains("codec")) fail_input("{}: \"codec\" is missing", where);
  for (const auto& [name, value] : element.items()) {
    if (name.empty() || name.front() == '-') {
      fail_input("{}: \"{}\": options stand without dashes", where, shown(name));
    }
  }
}

// All combinations, the last option changing fastest.
std::vector<TradeoffPoint> product_of(const json& element, const std::string& where) {
  check_names(element, where);
  std::vector<TradeoffPoint> points;
  for (const Choice& codec : choices_of("codec", element.at("codec"), where)) {
    if (codec.size() != 2) fail_input("{}: \"codec\" is not the name of a codec", where);
    points.push_back({codec.back(), {}});
  }
  for (const auto& [name, value] : element.items()) {
    if (name == "codec") continue;
    std::vector<TradeoffPoint> longer;
    const std::vector<Choice> choices = choices_of(name, value, where);
    if (points.size() * choices.size() > most_points) {
      fail_input("{}: more than {} points", where, most_points);
    }
    for (const TradeoffPoint& point : points) {
      for (const Choice& choice : choices) {
        longer.push_back(point);
        longer.back().options.insert(longer.back().options.end(), choice.begin(), choice.end());
      }
    }
    points = std::move(longer);
  }
  return points;
}

// Options that a run gives itself.
void check_own_options(const TradeoffPoint& point) {
  constexpr std::array own{"-o",     "--output",  "--json", "--quiet", "--ssim", "--codec",
                           "--help", "--profile", "-h",     "--into",  "--names"};
  for (const std::string& word : point.options) {
    const std::string name = word.substr(0, word.find('='));
    if (std::ranges::find(own, name) != own.end()) {
      fail_input("{}: {} is no option of a point", text_of(point), name);
    }
  }
}

// An option of another codec alone would be refused once the point runs.
void check_parameters(const TradeoffPoint& point, const Codec& codec) {
  const auto has = [](const Codec& of, std::string_view name) {
    const auto parameters = of.parameters();
    return std::ranges::any_of(parameters, [&](const ParameterSpec& s) { return s.name == name; });
  };
  for (const std::string& word : point.options) {
    if (!word.starts_with("--")) continue;
    const std::string name = word.substr(2, word.find('=') - 2);
    const bool known = std::ranges::any_of(codecs(), [&](const Codec* c) { return has(*c, name); });
    if (known && !has(codec, name)) {
      fail_input("{}: --{} is not a parameter of codec {}", text_of(point), name, codec.name());
    }
  }
}

}  // namespace

std::string text_of(const TradeoffPoint& point) {
  std::vector<std::string> words{point.codec};
  words.insert(words.end(), point.options.begin(), point.options.end());
  return join_words(words);
}

std::vector<std::string> split_words(std::string_view text, std::string_view where) {
  std::vector<std::string> words;
  bool open = false;  // inside a word
  char quote = 0;
  for (const char c : text) {
    if (quote != 0) {
      if (c == quote) {
        quote = 0;
      } else {
        words.back() += c;
      }
    } else if (is_blank(c)) {
      open = false;
    } else {
      if (!open) words.emplace_back();
      open = true;
      if (c == '\'' || c == '"') {
        quote = c;
      } else {
        words.back() += c;
      }
    }
  }
  if (quote != 0) fail_input("{}: '{}' has a quote that is not closed", where, shown(text));
  return words;
}

std::string join_words(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) {
    if (!text.empty()) text += ' ';
    if (!word.empty() && std::ranges::all_of(word, is_plain)) {
      text += word;
      continue;
    }
    text += '\'';
    for (const char c : word) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
    text += '\'';
  }
  return text;
}

TradeoffPoint parse_point(std::string_view text, std::string_view where) {
  std::vector<std::string> words = split_words(text, where);
  if (!words.empty() && words.front() == "--codec") words.erase(words.begin());
  if (words.empty() || words.front().starts_with('-')) {
    fail_input("{}: '{}' does not begin with a codec", where, shown(text));
  }
  return {words.front(), {words.begin() + 1, words.end()}};
}

std::vector<TradeoffPoint> parse_grid(std::string_view text, std::string_view where) {
  const json grid = parse_json(text, where);
  const json& elements = grid.is_object() && grid.contains("points") ? grid.at("points") : grid;
  if (!elements.is_array() || elements.empty()) {
    fail_input("{}: neither a list of points nor an object that has one as \"points\"", where);
  }
  std::vector<TradeoffPoint> points;
  std::size_t number = 0;
  for (const json& element : elements) {
    const std::string place = fmt::format("{}: element {}", where, ++number);
    std::vector<TradeoffPoint> some;
    if (element.is_string()) {
      some.push_back(parse_point(element.get<std::string>(), place));
    } else if (element.is_object()) {
      some = product_of(element, place);
    } else {
      fail_input("{}: neither the text of a point nor an object of options", place);
    }
    for (TradeoffPoint& point : some) {
      if (std::ranges::find(points, point) == points.end()) points.push_back(std::move(point));
    }
    if (points.size() > most_points) fail_input("{}: more than {} points", where, most_points);
  }
  return points;
}

std::vector<TradeoffPoint> read_grid(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  if (!file) fail_input("{}: cannot be read", path.string());
  return parse_grid(text, path.string());
}

std::string_view default_grid_text() {
  return tradeoff_texts::grid;
}

void check_point(const TradeoffPoint& point) {
  check_own_options(point);
  if (point.codec != "auto") check_parameters(point, find_codec(point.codec));
  // The subcommand's own parser knows the rest. It takes words from the end.
  CLI::App program;
  Action action;
  add_compress(program, action);
  std::vector<std::string> words{"compress", "input", "-o", "model.weft", "--codec", point.codec};
  words.insert(words.end(), point.options.begin(), point.options.end());
  std::ranges::reverse(words);
  try {
    program.parse(std::move(words));
  } catch (const CLI::Error& error) {
    fail_input("{}: {}", text_of(point), error.what());
  } catch (const Error& error) {
    fail_input("{}: {}", text_of(point), error.what());
  }
  const std::vector<std::string>& inputs =
      program.get_subcommand("compress")->get_option("INPUT")->results();
  if (inputs.size() > 1) {
    fail_input("{}: {} is no option of a point", text_of(point), inputs.back());
  }
}

}  // namespace weft
