// Completion scripts and manual pages, made from the command tree itself.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/config_reader.hpp"
#include "base/files.hpp"
#include "hedgehop_version.hpp"
#include "verbs.hpp"

namespace hedgehop::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct OptionWords {
  std::vector<std::string> names;  // "-q", "--quiet"; one name of a positional
  std::string description;
  std::string type;                  // "TEXT"; empty for a flag
  std::vector<std::string> choices;  // all that its value may be, if that is a list
  bool is_positional = false;
  bool is_required = false;
};

struct Verb {
  std::string path;  // "hedgehop log info"
  std::string name;
  std::string description;
  std::string footer;
  std::vector<OptionWords> options;
  std::vector<Verb> below;
};

// "TEXT:{global,local}" names its choices.
std::vector<std::string> choices_of(const std::string& type) {
  std::vector<std::string> choices;
  const std::size_t open = type.find('{');
  const std::size_t close = type.find('}');
  if (open != std::string::npos && close != std::string::npos && open < close) {
    std::string rest = type.substr(open + 1, close - open - 1) + ",";
    for (std::size_t comma = 0; (comma = rest.find(',')) != std::string::npos;) {
      choices.push_back(rest.substr(0, comma));
      rest.erase(0, comma + 1);
    }
  }
  return choices;
}

Verb verb_of(const CLI::App& app, const std::string& above) {
  Verb verb;
  verb.name = app.get_name();
  verb.path = above.empty() ? verb.name : above + " " + verb.name;
  verb.description = app.get_description();
  verb.footer = app.get_footer();
  for (const CLI::Option* option : app.get_options()) {
    OptionWords words;
    for (const std::string& name : option->get_snames()) {
      words.names.push_back("-" + name);
    }
    for (const std::string& name : option->get_lnames()) {
      words.names.push_back("--" + name);
    }
    words.is_positional = words.names.empty();
    if (words.is_positional) {
      words.names.push_back(option->get_name(true));
    }
    words.description = option->get_description();
    words.type = option->get_type_size() == 0 ? "" : option->get_type_name();
    words.choices = choices_of(words.type);
    words.is_required = option->get_required();
    verb.options.push_back(std::move(words));
  }
  for (const CLI::App* below : app.get_subcommands([](const CLI::App*) { return true; })) {
    verb.below.push_back(verb_of(*below, verb.path));
  }
  return verb;
}

template <typename Visit>
void for_each_verb(const Verb& verb, const Visit& visit) {
  visit(verb);
  for (const Verb& below : verb.below) {
    for_each_verb(below, visit);
  }
}

std::string joined(const std::vector<std::string>& words, const std::string& separator) {
  std::string text;
  for (const std::string& word : words) {
    text += (text.empty() ? "" : separator) + word;
  }
  return text;
}

// Text between single quotes, for all three shells.
std::string quoted(const std::string& text) {
  std::string safe;
  for (const char c : text) {
    // A quote inside would end the text; an apostrophe of typography reads as well.
    safe += c == '\'' ? std::string("\u2019") : c == '\\' ? std::string("/") : std::string(1, c);
  }
  return "'" + safe + "'";
}

// What the scripts ask: which words lead on to a verb, after which words a value follows.
struct Patterns {
  std::vector<std::string> verbs;   // "hedgehop log info"
  std::vector<std::string> values;  // "hedgehop plan --map", where any value may follow
  std::vector<std::pair<std::string, std::vector<std::string>>> choices;
};

Patterns patterns_of(const Verb& root) {
  Patterns patterns;
  for_each_verb(root, [&](const Verb& verb) {
    if (&verb != &root) {
      patterns.verbs.push_back("\"" + verb.path + "\"");
    }
    for (const OptionWords& option : verb.options) {
      if (option.is_positional || option.type.empty()) {
        continue;
      }
      for (const std::string& name : option.names) {
        const std::string pattern = "\"" + verb.path + " " + name + "\"";
        if (option.choices.empty()) {
          patterns.values.push_back(pattern);
        } else {
          patterns.choices.emplace_back(pattern, option.choices);
        }
      }
    }
  });
  return patterns;
}

std::string bash_script(const Verb& root) {
  const Patterns patterns = patterns_of(root);
  std::string text =
      "# bash completion of hedgehop: source it, or put it into "
      "/usr/share/bash-completion/completions/hedgehop\n"
      "_hedgehop() {\n"
      "  local current=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]}\n"
      "  local verb=hedgehop words='' i\n"
      "  for ((i = 1; i < COMP_CWORD; i++)); do\n"
      "    case \"$verb ${COMP_WORDS[i]}\" in\n"
      "      " +
      joined(patterns.verbs, "|") +
      ") verb=\"$verb ${COMP_WORDS[i]}\" ;;\n"
      "    esac\n"
      "  done\n"
      "  COMPREPLY=()\n"
      "  case \"$verb $before\" in\n";
  for (const auto& [pattern, choices] : patterns.choices) {
    text += "    " + pattern + ") COMPREPLY=($(compgen -W " + quoted(joined(choices, " ")) +
            " -- \"$current\")); return ;;\n";
  }
  text += "    " + joined(patterns.values, "|") + ") return ;;\n  esac\n  case \"$verb\" in\n";
  for_each_verb(root, [&](const Verb& verb) {
    std::vector<std::string> words;
    for (const Verb& below : verb.below) {
      words.push_back(below.name);
    }
    for (const OptionWords& option : verb.options) {
      if (option.is_positional) {
        words.insert(words.begin(), option.choices.begin(), option.choices.end());
      } else {
        words.push_back(option.names.back());
      }
    }
    text += "    \"" + verb.path + "\") words=" + quoted(joined(words, " ")) + " ;;\n";
  });
  text +=
      "  esac\n"
      "  COMPREPLY=($(compgen -W \"$words\" -- \"$current\"))\n"
      "  # where a file may stand, options come only when asked for\n"
      "  if [[ $current != -* && $words == -* ]]; then COMPREPLY=(); fi\n"
      "}\n"
      "complete -o default -F _hedgehop hedgehop\n";
  return text;
}

std::string zsh_script(const Verb& root) {
  const Patterns patterns = patterns_of(root);
  std::string text =
      "#compdef hedgehop\n"
      "# zsh completion of hedgehop: put it as _hedgehop into a folder of $fpath\n"
      "_hedgehop() {\n"
      "  local verb=hedgehop\n"
      "  local -a verbs options\n"
      "  integer i\n"
      "  for ((i = 2; i < CURRENT; i++)); do\n"
      "    case \"$verb ${words[i]}\" in\n"
      "      (" +
      joined(patterns.verbs, "|") +
      ") verb=\"$verb ${words[i]}\" ;;\n"
      "    esac\n"
      "  done\n"
      "  case \"$verb ${words[CURRENT-1]}\" in\n";
  for (const auto& [pattern, choices] : patterns.choices) {
    text += "    (" + pattern + ") compadd -- " + joined(choices, " ") + "; return ;;\n";
  }
  text += "    (" + joined(patterns.values, "|") + ") _files; return ;;\n  esac\n" +
          "  case \"$verb\" in\n";
  for_each_verb(root, [&](const Verb& verb) {
    text += "    (\"" + verb.path + "\")\n      verbs=(";
    for (const Verb& below : verb.below) {
      text += " " + quoted(below.name + ":" + below.description);
    }
    for (const OptionWords& option : verb.options) {
      for (const std::string& choice : option.choices) {
        text += option.is_positional ? " " + quoted(choice + ":" + option.description) : "";
      }
    }
    text += " )\n      options=(";
    for (const OptionWords& option : verb.options) {
      if (!option.is_positional) {
        text += " " + quoted(option.names.back() + ":" + option.description);
      }
    }
    text += " ) ;;\n";
  });
  text +=
      "  esac\n"
      "  if [[ ${words[CURRENT]} == -* ]]; then\n"
      "    _describe -o option options\n"
      "  elif (( ${#verbs} )); then\n"
      "    _describe verb verbs\n"
      "  else\n"
      "    _files\n"
      "  fi\n"
      "}\n"
      "if [[ ${funcstack[1]} == _hedgehop ]]; then _hedgehop \"$@\"; else compdef _hedgehop "
      "hedgehop; "
      "fi\n";
  return text;
}

std::string fish_script(const Verb& root) {
  const Patterns patterns = patterns_of(root);
  std::string text =
      "# fish completion of hedgehop: put it into ~/.config/fish/completions/hedgehop.fish\n"
      "function __hedgehop_at\n"
      "  set -l verb hedgehop\n"
      "  set -l typed (commandline -opc)\n"
      "  for word in $typed[2..-1]\n"
      "    switch \"$verb $word\"\n"
      "      case " +
      joined(patterns.verbs, " ") +
      "\n        set verb \"$verb $word\"\n"
      "    end\n"
      "  end\n"
      "  test \"$verb\" = \"$argv\"\n"
      "end\n";
  for_each_verb(root, [&](const Verb& verb) {
    const std::string here = "complete -c hedgehop -n '__hedgehop_at " + verb.path + "'";
    for (const Verb& below : verb.below) {
      text += here + " -f -a " + below.name + " -d " + quoted(below.description) + "\n";
    }
    for (const OptionWords& option : verb.options) {
      if (option.is_positional) {
        if (!option.choices.empty()) {
          text += here + " -f -a " + quoted(joined(option.choices, " ")) + " -d " +
                  quoted(option.description) + "\n";
        }
        continue;
      }
      text += here;
      for (const std::string& name : option.names) {
        text += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
      }
      if (!option.choices.empty()) {
        text += " -x -a " + quoted(joined(option.choices, " "));
      } else if (!option.type.empty()) {
        text += " -r";
      }
      text += " -d " + quoted(option.description) + "\n";
    }
  });
  return text;
}

// ---- manual pages

std::string roff(const std::string& text) {
  std::string safe;
  for (const char c : text) {
    safe += c == '\\' ? std::string("\\e") : c == '-' ? std::string("\\-") : std::string(1, c);
  }
  // A point or an apostrophe in front would be a request.
  return safe.starts_with('.') || safe.starts_with('\'') ? "\\&" + safe : safe;
}

std::string page_name(const Verb& verb) {
  std::string name = verb.path;
  std::replace(name.begin(), name.end(), ' ', '-');
  return name;
}

// Paragraphs, lines that begin with blanks as they stand, and a heading for examples.
std::string footer_as_roff(const std::string& footer) {
  std::string text;
  bool is_verbatim = false;
  std::string rest = footer + "\n";
  while (!rest.empty()) {
    const std::size_t end = rest.find('\n');
    const std::string line = rest.substr(0, end);
    rest.erase(0, end + 1);
    const bool is_indented = line.starts_with("  ");
    if (is_indented != is_verbatim) {
      text += is_indented ? ".PP\n.nf\n.RS\n" : ".RE\n.fi\n.PP\n";
      is_verbatim = is_indented;
    }
    if (line == "Example:" || line == "Examples:") {
      text += ".SH EXAMPLES\n";
    } else if (!line.empty()) {
      text += roff(is_indented ? line.substr(2) : line) + "\n";
    }
  }
  return text + (is_verbatim ? ".RE\n.fi\n" : "");
}

std::string man_page(const Verb& verb) {
  std::string title = page_name(verb);
  std::transform(title.begin(), title.end(), title.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  std::string text = ".TH \"" + roff(title) +
                     "\" 1 \"\" \"hedgehop " HEDGEHOP_VERSION "\" \"hedgehop\"\n.SH NAME\n" +
                     roff(page_name(verb)) + " \\- " + roff(verb.description) +
                     "\n.SH SYNOPSIS\n.B " + roff(verb.path) + "\n";
  for (const OptionWords& option : verb.options) {
    if (option.is_positional) {
      text += option.is_required ? ".I " + roff(option.names[0]) + "\n"
                                 : "[\\fI" + roff(option.names[0]) + "\\fR]\n";
    } else if (option.is_required) {
      text += "\\fB" + roff(option.names.back()) + "\\fR \\fI" + roff(option.type) + "\\fR\n";
    }
  }
  text += verb.below.empty() ? "[\\fIOPTIONS\\fR]\n" : "\\fIVERB\\fR\n";
  text += ".SH DESCRIPTION\n" + roff(verb.description) +
          (verb.description.ends_with('.') ? "\n" : ".\n");
  std::string footer = footer_as_roff(verb.footer);
  const std::size_t examples = footer.find(".SH EXAMPLES\n");
  if (!footer.empty()) {
    text += ".PP\n" + footer.substr(0, examples);
  }
  if (!verb.below.empty()) {
    text += ".SH VERBS\n";
    for (const Verb& below : verb.below) {
      text += ".TP\n\\fB" + roff(below.name) + "\\fR\n" + roff(below.description) + "\n";
    }
  }
  text += ".SH OPTIONS\n";
  for (const OptionWords& option : verb.options) {
    text += ".TP\n\\fB" + roff(joined(option.names, ", ")) + "\\fR";
    if (!option.type.empty()) {
      text += " \\fI" + roff(option.type) + "\\fR";
    }
    text += "\n" + roff(option.description) + (option.is_required ? " (required)" : "") + "\n";
  }
  if (examples != std::string::npos) {
    text += footer.substr(examples);
  }
  std::vector<std::string> also;
  if (verb.path != verb.name) {
    also.push_back(verb.path.substr(0, verb.path.rfind(' ')));
  }
  for (const Verb& below : verb.below) {
    also.push_back(below.path);
  }
  if (!also.empty()) {
    text += ".SH SEE ALSO\n";
    for (std::size_t i = 0; i < also.size(); ++i) {
      std::replace(also[i].begin(), also[i].end(), ' ', '-');
      text += "\\fB" + roff(also[i]) + "\\fR(1)" + (i + 1 < also.size() ? ",\n" : "\n");
    }
  }
  return text;
}

void print_json(const Json& json) {
  std::printf("%s\n", json.dump(2, ' ', false, Json::error_handler_t::replace).c_str());
}

const Verb& found_verb(const Verb& root, const std::vector<std::string>& words) {
  const Verb* verb = &root;
  for (const std::string& word : words) {
    const auto below = std::find_if(verb->below.begin(), verb->below.end(),
                                    [&](const Verb& candidate) { return candidate.name == word; });
    if (below == verb->below.end()) {
      std::vector<std::string> known;
      for (const Verb& candidate : verb->below) {
        known.push_back(candidate.name);
      }
      const auto nearest = nearest_word(word, known);
      throw UsageError(
          "'" + verb->path + "' has no verb '" + word + "'",
          nearest ? "did you mean '" + *nearest + "'?" : "see " + verb->path + " --help");
    }
    verb = &*below;
  }
  return *verb;
}

ExitCode write_pages(const Console& console, const Verb& root, const fs::path& folder,
                     bool is_overwriting) {
  std::vector<std::pair<fs::path, std::string>> pages;
  std::error_code error;
  for_each_verb(root, [&](const Verb& verb) {
    pages.emplace_back(folder / (page_name(verb) + ".1"), man_page(verb));
    if (!is_overwriting && fs::exists(pages.back().first, error)) {
      throw UsageError("output file " + pages.back().first.string() + " exists already",
                       "choose another folder, or add --overwrite to replace it");
    }
  });
  if (!fs::is_directory(folder, error) && !fs::create_directory(folder, error)) {
    throw UsageError("the folder " + folder.string() + " cannot be made: " + error.message(),
                     "create the folder above it first, or choose another place");
  }
  Json list = Json::array();
  for (const auto& [path, text] : pages) {
    write_file_atomically(path, text);
    list.push_back(path.string());
    if (!console.is_json) {
      std::printf("%s\n", path.c_str());
    }
  }
  if (console.is_json) {
    print_json(
        {{"schema", "hedgehop man pages"}, {"schema_version", 1}, {"pages", std::move(list)}});
  }
  return ExitCode::kOk;
}

}  // namespace

void add_completion_verbs(CLI::App& app, Console& console) {
  auto* completion = app.add_subcommand("completion", "Script that lets a shell complete hedgehop");
  completion->footer(
      "Made from the command tree, so it knows every verb and option of this version.\n"
      "Examples:\n"
      "  source <(hedgehop completion bash)\n"
      "  hedgehop completion fish > ~/.config/fish/completions/hedgehop.fish");
  auto shell = std::make_shared<std::string>();
  completion->add_option("shell", *shell, "Which shell")
      ->required()
      ->check(CLI::IsMember({"bash", "zsh", "fish"}));
  add_common_options(*completion, console);
  completion->callback([&app, &console, shell] {
    console.action = [&app, &console, shell] {
      const Verb root = verb_of(app, "");
      const std::string script = *shell == "bash"  ? bash_script(root)
                                 : *shell == "zsh" ? zsh_script(root)
                                                   : fish_script(root);
      if (console.is_json) {
        print_json({{"schema", "hedgehop completion"},
                    {"schema_version", 1},
                    {"shell", *shell},
                    {"script", script}});
      } else {
        std::fputs(script.c_str(), stdout);
      }
      return ExitCode::kOk;
    };
  });

  struct ManArguments {
    std::vector<std::string> words;
    std::string out;
    bool is_overwriting = false;
  };
  auto* man = app.add_subcommand("man", "Manual pages of hedgehop and its verbs");
  man->footer(
      "Without --out the page of one verb, as man reads it.\n"
      "Examples:\n"
      "  hedgehop man plan | man -l -\n"
      "  hedgehop man --out man1");
  auto arguments = std::make_shared<ManArguments>();
  man->add_option("verb", arguments->words, "Verb whose page is wanted: plan, log info, ...");
  man->add_option("--out", arguments->out,
                  "Folder to write all pages to, hedgehop-plan.1 and so on");
  man->add_flag("--overwrite", arguments->is_overwriting, "Replace existing pages");
  add_common_options(*man, console);
  man->callback([&app, &console, arguments] {
    console.action = [&app, &console, arguments] {
      const Verb root = verb_of(app, "");
      if (!arguments->out.empty()) {
        return write_pages(console, root, arguments->out, arguments->is_overwriting);
      }
      const std::string page = man_page(found_verb(root, arguments->words));
      if (console.is_json) {
        print_json({{"schema", "hedgehop man page"}, {"schema_version", 1}, {"page", page}});
      } else {
        std::fputs(page.c_str(), stdout);
      }
      return ExitCode::kOk;
    };
  });
}

}  // namespace hedgehop::cli
