// SPDX-License-Identifier: GPL-3.0-or-later
// What the lint rules of all dialects share: a list of named checks, and the rules G-.. that hold for every dialect.
#pragma once

#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "postprocessors/post.hpp"
#include "postprocessors/reading.hpp"

namespace asbuilt::linting {

/// Collects findings by rule. Every rule named at the start appears among the checks, passed or not.
class Findings {
 public:
  /// Errors fail their check; warnings pass and only count.
  Findings(std::vector<std::string_view> errors, std::vector<std::string_view> warnings);
  void add(std::string_view rule, const std::string& where, const std::string& what);
  void add(std::string_view rule, const reading::Line& line, const std::string& what) { add(rule, reading::place(line), what); }
  std::vector<Check> checks() const;

 private:
  struct Rule {
    bool is_error = true;
    int count = 0;
    std::string first;
  };
  std::map<std::string, Rule, std::less<>> rules_;
};

/// G-01 (bytes), G-02 (numbers) on the text; G-03 (joints inside limits), G-04 (order), G-05 (end), G-06 (feed), G-07 (points too
/// close), G-10 (spindle), G-14 to G-17 (header) on what the dialect's own reader makes of it. A text that the reader refuses fails G-00.
///
/// `comment` gives for a line the part that is no comment.
void common_rules(Findings& findings, const ProgramText& text, const PostContext& context, Result<Program> (*read)(const ProgramText&, const PostContext&),
                  std::string_view (*code_of)(std::string_view line), bool needs_crlf);

/// G-14 (tool), G-15 (frame), G-16 (controller), G-17 (run, with its receipt): what the header states, held against the cell and the program.
void header_rules(Findings& findings, const Program& program, const PostContext& context, Language language);

/// A token of a line: a name in upper case (letters, digits, _ $ #), a number, or one other character.
struct Token {
  enum class Kind { name, number, other } kind = Kind::other;
  std::string text;
  double value = 0;
  bool is(std::string_view t) const { return text == t; }
};
std::vector<Token> tokens_of(std::string_view code);
/// The position of the first token that is `text`; npos where there is none.
std::size_t find(const std::vector<Token>& tokens, std::string_view text, std::size_t from = 0);
/// The number after `name` and an equals sign, a bracketed index or a comma: "$VEL.CP=0.1" asked for "CP".
std::optional<double> number_after(const std::vector<Token>& tokens, std::string_view name);

/// Lines of a file without their ends; any byte is taken.
std::vector<reading::Line> raw_lines(const ProgramFile& file);
std::string stem_of(const std::string& file_name);
std::string upper_of(std::string_view text);

extern const std::vector<std::string_view> kCommonErrors, kCommonWarnings;
std::vector<std::string_view> joined(std::vector<std::string_view> a, const std::vector<std::string_view>& b);

}  // namespace asbuilt::linting
