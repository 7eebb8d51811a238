// How a subcommand joins the program: a file of its own defines one of the functions below, and the
// table in main.cpp lists it. The function adds the subcommand with its options, a description and
// a footer of worked examples, and has it set `action`, which main runs once the whole command line
// is known to be good:
//
//   void add_info(CLI::App& program, Action& action) {
//     auto options = std::make_shared<InfoOptions>();
//     CLI::App* command = program.add_subcommand("info", "what a file holds");
//     command->add_option("FILE", options->files, "...")->required();
//     command->callback([options, &action] { action = [options] { run_info(*options); }; });
//   }
//
// An action that cannot do its work throws a weft::Error; it never ends the process itself.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace weft {

using Action = std::function<void()>;

}  // namespace weft
