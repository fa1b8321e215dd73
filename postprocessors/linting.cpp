// SPDX-License-Identifier: GPL-3.0-or-later
#include "postprocessors/linting.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

namespace asbuilt::linting {

const std::vector<std::string_view> kCommonErrors = {"G-00", "G-01", "G-02", "G-03", "G-04", "G-05", "G-06", "G-10", "G-14", "G-15", "G-16", "G-17"};
const std::vector<std::string_view> kCommonWarnings = {"G-07"};

std::vector<std::string_view> joined(std::vector<std::string_view> a, const std::vector<std::string_view>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

Findings::Findings(std::vector<std::string_view> errors, std::vector<std::string_view> warnings) {
  for (std::string_view r : errors) rules_[std::string(r)] = {true};
  for (std::string_view r : warnings) rules_[std::string(r)] = {false};
}
void Findings::add(std::string_view rule, const std::string& where, const std::string& what) {
  const auto it = rules_.find(rule);
  must(it != rules_.end(), "a lint rule is not in its dialect's list");
  if (it->second.count++ == 0) it->second.first = where + " " + what;
}
std::vector<Check> Findings::checks() const {
  std::vector<Check> out;
  for (const auto& [name, rule] : rules_)
    out.push_back({.name = "lint." + name, .measured = static_cast<double>(rule.count), .limit = 0, .unit = "count", .where = rule.first,
                   .is_passed = rule.count == 0 || !rule.is_error});
  return out;
}

std::vector<Token> tokens_of(std::string_view code) {
  std::vector<Token> out;
  const auto digit = [](char c) { return c >= '0' && c <= '9'; };
  const auto word = [&](char c) { return digit(c) || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '_' || c == '$' || c == '#'; };
  for (std::size_t i = 0; i < code.size();) {
    const char c = code[i];
    if (c == ' ' || c == '\t') {
      ++i;
      continue;
    }
    Token t;
    std::size_t j = i;
    const bool is_signed = (c == '-' || c == '+') && i + 1 < code.size() && (digit(code[i + 1]) || code[i + 1] == '.') &&
                           (out.empty() || out.back().kind == Token::Kind::other || out.back().text != ")");
    if (digit(c) || (c == '.' && i + 1 < code.size() && digit(code[i + 1])) || (is_signed && !(i && word(code[i - 1]) && digit(code[i - 1])))) {
      j += is_signed ? 1 : 0;
      while (j < code.size() && (digit(code[j]) || code[j] == '.')) ++j;
      t.kind = Token::Kind::number;
      t.text = std::string(code.substr(i, j - i));
      std::from_chars(code.data() + i + (c == '+' ? 1 : 0), code.data() + j, t.value);
    } else if (word(c)) {
      while (j < code.size() && word(code[j])) ++j;
      t.kind = Token::Kind::name;
      t.text = upper_of(code.substr(i, j - i));
    } else {
      ++j;
      t.text = std::string(1, c);
    }
    out.push_back(std::move(t));
    i = j;
  }
  return out;
}
std::size_t find(const std::vector<Token>& tokens, std::string_view text, std::size_t from) {
  for (std::size_t i = from; i < tokens.size(); ++i)
    if (tokens[i].text == text) return i;
  return std::string::npos;
}
std::optional<double> number_after(const std::vector<Token>& tokens, std::string_view name) {
  const std::size_t i = find(tokens, name);
  if (i == std::string::npos || i + 1 >= tokens.size()) return std::nullopt;
  if (tokens[i + 1].kind == Token::Kind::number) return tokens[i + 1].value;
  if (i + 2 < tokens.size() && (tokens[i + 1].is("=") || tokens[i + 1].is(",") || tokens[i + 1].is("[") || tokens[i + 1].is("(")) &&
      tokens[i + 2].kind == Token::Kind::number)
    return tokens[i + 2].value;
  return std::nullopt;
}
std::vector<reading::Line> raw_lines(const ProgramFile& file) {
  std::vector<reading::Line> out;
  std::string_view rest = file.bytes;
  for (int number = 1; !rest.empty(); ++number) {
    const std::size_t n = rest.find('\n');
    reading::Line line{&file.name, number, rest.substr(0, n)};
    if (!line.text.empty() && line.text.back() == '\r') line.text.remove_suffix(1);
    out.push_back(line);
    if (n == std::string_view::npos) break;
    rest.remove_prefix(n + 1);
  }
  return out;
}
std::string upper_of(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
  return out;
}
std::string stem_of(const std::string& file_name) { return upper_of(std::string_view(file_name).substr(0, file_name.rfind('.'))); }

namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_word(char c) { return is_digit(c) || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '_' || c == '$'; }

void bytes_rule(Findings& f, const ProgramFile& file, bool needs_crlf) {
  int number = 1;
  bool has_bad_end = false;
  for (std::size_t i = 0; i < file.bytes.size(); ++i) {
    const char c = file.bytes[i];
    const auto where = [&] { return file.name + ":" + std::to_string(number); };
    if (c == '\n') {
      const bool has_cr = i > 0 && file.bytes[i - 1] == '\r';
      if (has_cr != needs_crlf && !has_bad_end) {
        f.add("G-01", where(), needs_crlf ? "line without CR LF" : "line end CR LF");
        has_bad_end = true;
      }
      const std::size_t last = i - (has_cr ? 1 : 0);
      if (last > 0 && (file.bytes[last - 1] == ' ')) f.add("G-01", where(), "blank at the end of the line");
      ++number;
    } else if (c == '\r') {
      if (i + 1 == file.bytes.size() || file.bytes[i + 1] != '\n') f.add("G-01", where(), "CR without LF");
    } else if (c < 0x20 || c > 0x7e) {
      f.add("G-01", where(), "byte " + std::to_string(static_cast<unsigned char>(c)));
    }
  }
  if (file.bytes.empty() || file.bytes.back() != '\n') f.add("G-01", file.name + ":" + std::to_string(number), "no line end at the end of the file");
}

/// Numbers outside comments: no exponent, no negative zero, no number that is none.
void numbers_rule(Findings& f, const reading::Line& line, std::string_view code) {
  for (std::size_t i = 0; i < code.size();) {
    if (is_word(code[i]) && !is_digit(code[i])) {
      std::size_t j = i;
      while (j < code.size() && is_word(code[j])) ++j;
      std::string w(code.substr(i, j - i));
      for (char& c : w) c = static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
      if (w == "nan" || w == "inf" || w == "infinity") f.add("G-02", line, "\"" + w + "\"");
      std::size_t digits = j;
      while (digits > i && is_digit(code[digits - 1])) --digits;
      if (j < code.size() && code[j] == '.' && j - digits > 1 && code[digits] == '0') f.add("G-02", line, "a number with a zero before its first digit");
      i = j;
      if (i < code.size() && is_digit(code[i - 1]) && code[i] == '.') ++i;  // X10.5: the word held the digits
      continue;
    }
    const bool is_minus = code[i] == '-' && i + 1 < code.size() && (is_digit(code[i + 1]) || code[i + 1] == '.');
    const bool is_point = code[i] == '.' && i + 1 < code.size() && is_digit(code[i + 1]) && (i == 0 || !is_digit(code[i - 1]));
    if (is_point || (is_minus && code[i + 1] == '.')) f.add("G-02", line, "a number that begins with its point");
    if (!is_digit(code[i]) && !is_minus) {
      ++i;
      continue;
    }
    std::size_t j = i + (is_minus ? 1 : 0);
    const std::size_t begin = j;
    bool is_zero = true;
    while (j < code.size() && (is_digit(code[j]) || code[j] == '.')) is_zero &= code[j] == '0' || code[j] == '.', ++j;
    if (code[begin] == '0' && begin + 1 < code.size() && is_digit(code[begin + 1]) && (begin == 0 || code[begin - 1] != '.')) f.add("G-02", line, "a number with a zero before its first digit");
    if (is_minus && is_zero) f.add("G-02", line, "negative zero " + std::string(code.substr(i, j - i)));
    if (std::count(code.begin() + begin, code.begin() + j, '.') > 1) f.add("G-02", line, std::string(code.substr(i, j - i)));
    if (j + 1 < code.size() && (code[j] == 'e' || code[j] == 'E') && (is_digit(code[j + 1]) || code[j + 1] == '+' || code[j + 1] == '-'))
      f.add("G-02", line, "exponent after " + std::string(code.substr(i, j - i)));
    i = j;
  }
}

struct Walk {
  Findings& f;
  const PostContext& context;
  const std::string& name;
  std::size_t at = 0;
  bool has_tool = false, has_frame = false, has_joint = false, is_spinning = false, has_spun = false, ends_at_joint = false;
  std::array<bool, 5> is_on{};
  std::optional<Vec3> p_now;
  std::string where() const { return name + ": motion " + std::to_string(at + 1); }

  void path(const Pose<frame::Base, frame::Tool>& T, double speed_mm_s) {
    if (!has_tool || !has_frame || !has_joint) f.add("G-04", where(), "motion before tool, frame and a joint motion");
    if (!(speed_mm_s > 0)) f.add("G-06", where(), "feed is not positive");
    if (speed_mm_s > 3000) f.add("G-06", where(), "feed above 3000 mm/s");
    if (p_now && (*p_now - T.p_mm).norm() < 0.0015) f.add("G-07", where(), "the point before is nearer than 0.0015 mm");
    p_now = T.p_mm;
    ends_at_joint = false;
    ++at;
  }
  void operator()(const SetTool&) { has_tool = true; }
  void operator()(const SetFrame&) { has_frame = true; }
  void operator()(const MoveJoint& m) {
    if (!has_tool) f.add("G-04", where(), "motion before a tool");
    for (int i = 0; i < 6; ++i) {
      const JointSpec& j = context.cell.robot.joints[i];
      if (j.max_rad > j.min_rad && (m.q_rad[i] < j.min_rad - 2e-5 || m.q_rad[i] > j.max_rad + 2e-5))
        f.add("G-03", where(), "joint " + std::to_string(i + 1) + " is outside its limits");
    }
    if (is_on[static_cast<std::size_t>(Equipment::arc)]) f.add("G-10", where(), "a joint motion with the arc on");
    has_joint = ends_at_joint = true;
    p_now.reset();
    ++at;
  }
  void operator()(const MoveLinear& m) { path(m.T_base_tool, m.speed_mm_s); }
  void operator()(const MoveCircular& m) { path(m.T_base_tool, m.speed_mm_s); }
  void operator()(const MoveSpline& m) { path(m.T_base_tool, m.speed_mm_s); }
  void operator()(const OutputOnPath&) {}
  void operator()(const SwitchOn& s) {
    if (s.what == Equipment::tool_check) return;
    if (!has_joint) f.add("G-10", where(), std::string(name_of(s.what)) + " starts before the first motion is commanded");
    is_on[static_cast<std::size_t>(s.what)] = true;
  }
  void operator()(const SwitchOff& s) { is_on[static_cast<std::size_t>(s.what)] = false; }
  void operator()(const SpindleOn&) {
    if (!has_joint) f.add("G-10", where(), "the spindle starts before the first motion is commanded");
    is_spinning = has_spun = true;
  }
  void operator()(const SpindleOff&) { is_spinning = false; }
  void operator()(const SetOutput&) {}
  void operator()(const Wait&) {}
  void operator()(const Comment&) {}
};

}  // namespace

void common_rules(Findings& findings, const ProgramText& text, const PostContext& context, Result<Program> (*read)(const ProgramText&, const PostContext&),
                  std::string_view (*code_of)(std::string_view line), bool needs_crlf) {
  for (const ProgramFile& file : text.files) {
    bytes_rule(findings, file, needs_crlf);
    for (const reading::Line& line : raw_lines(file)) numbers_rule(findings, line, code_of(line.text));
  }
  const Result<Program> program = read(text, context);
  if (!program) {
    findings.add("G-00", program.error().front().where, program.error().front().code + " " + program.error().front().message);
    return;
  }
  header_rules(findings, *program, context, text.language);
  Walk w{findings, context, program->name};
  for (const Instruction& i : program->instructions) std::visit(w, i);
  if (w.is_spinning) findings.add("G-05", w.where(), "the spindle is on at the end");
  for (const Equipment e : {Equipment::coolant, Equipment::arc, Equipment::weave, Equipment::recording})
    if (w.is_on[static_cast<std::size_t>(e)]) findings.add("G-05", w.where(), std::string(name_of(e)) + " is on at the end");
  if (!w.has_joint) findings.add("G-05", w.where(), "the program holds no joint motion");
  else if (!w.ends_at_joint) findings.add("G-05", w.where(), "the program does not end at a joint target away from the work");
}

}  // namespace asbuilt::linting
