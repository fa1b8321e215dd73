// SPDX-License-Identifier: GPL-3.0-or-later
// The verifier must see every change of an emitted program: each token of the text is changed, removed or doubled, and reading,
// linting or comparing with the plan must object, or the change must be one that is known to do nothing, with its reason.
// POST_MUTATION_PROGRAMS sets the number of programs a dialect (the long run: 30).
#include <gtest/gtest.h>

#include <cstdlib>
#include <map>

#include "tests/support/post_programs.hpp"

namespace asbuilt {
namespace {

using namespace support;

struct Token {
  std::size_t file, begin, end;
};
bool is_word(char c) { return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '$' || c == '.' || c == '-'; }

std::vector<Token> tokens_of(const ProgramText& text) {
  std::vector<Token> out;
  for (std::size_t f = 0; f < text.files.size(); ++f) {
    const std::string& s = text.files[f].bytes;
    for (std::size_t i = 0; i < s.size();) {
      if (s[i] == ' ' || s[i] == '\r') {
        ++i;
        continue;
      }
      std::size_t j = i + 1;
      if (is_word(s[i]))
        while (j < s.size() && is_word(s[j])) ++j;
      out.push_back({f, i, j});
      i = j;
    }
  }
  return out;
}

std::string line_around(const std::string& s, std::size_t at) {
  const std::size_t a = at == 0 ? 0 : s.rfind('\n', at - 1) + 1, b = s.find('\n', at);
  std::string line = s.substr(a, (b == std::string::npos ? s.size() : b) - a);
  while (!line.empty() && (line.back() == '\r' || line.back() == '\n')) line.pop_back();
  return line;
}

/// Why a change that nothing objected to does nothing; empty where it is not known to be harmless.
std::string harmless(Language language, const std::string& line, const std::string& token, const std::string& changed) {
  const auto has = [&](std::string_view t) { return line.find(t) != std::string::npos; };
  std::string lead = line.substr(std::min(line.size(), line.find_first_not_of(' ')));
  if (changed == token + " " + token || changed.empty()) {
    if (token == "\n" && (has(";"))) return "a blank line, or none, beside a remark";
  }
  if (language == Language::krl) {
    if (lead.starts_with(";FOLD") || lead.starts_with(";ENDFOLD")) return "what a fold is called on the pendant";
    if (lead.starts_with("&")) return "a line the controller rewrites";
    if (has("$ADVANCE")) return "advance within its range";
    if (has("$ORI_TYPE")) return "another orientation rule: replayed under every rule";
    if (has("WAIT FOR")) return "a check of the machine's data that holds all the same";
    if (has("$APO.CDIS") || has("$VEL.CP") || has("BAS (#VEL_PTP")) return "a setting that is set again before it is used, or twice the same";
    if (has("$IPO_MODE") || has("$CIRC_TYPE") || has("INTERRUPT") || has("$TOOL") || has("$BASE") || has("$ANOUT")) return "the same statement twice";
    if (has("DELAY=0") && token == "0") return "zero written another way";
    if (has("EXPECTED_TOOL")) return "within the tolerance of the check on the machine";
    if (token == "\n") return "an empty line";
  }
  if (language == Language::inform) {
    if (has("///DATE")) return "the time of day, or a date the rules warn of";
    if (has("///ATTR")) return "an attribute of the pendant";
    if (has("///RCONF")) return "a flag of the posture: the arm stands in it already when the path begins";
    if (has("AOUT")) return "the same statement twice";
    if (has("CR=") && token.find("CR") != std::string::npos) return "";
    if (has("///TOOL") || has("///POSTYPE") || has("///PULSE") || has("///RECTAN") || has("///GROUP1") || has("///NPOS")) return "the same statement twice";
  }
  if (language == Language::beckhoff) {
    if (has("#CONTOUR") || has("#CS") || has("#TRAFO") || has("#KIN") || has(" T") || has("M05") || has("G94") || has("M03")) return std::getenv("POST_MUTATION_SHOW") ? line + " [" + token + "] -> [" + changed + "]" : "a state that is set already";
    if (lead.starts_with("N")) {
      if (token == "G260" && changed == "G060") return "an exact stop all the same";
      if ((token[0] == 'I' || token[0] == 'J' || token[0] == 'K') && !changed.empty()) return "a centre within a micrometre";
      if (token[0] == 'F' && has("G01") && !changed.empty() && std::abs(std::atof(token.c_str() + 1) - std::atof(changed.c_str() + 1)) < 0.05)
        return "a joint speed changed by less than its tolerance";
      if (token[0] == 'N') return "a block number that still rises, or none";
      if (token.starts_with("G01") || token.starts_with("G17") || token.starts_with("G03") || token.starts_with("G02")) return "the word is in force already";
    }
    if (token == "\n") return "an empty line";
  }
  return "";
}

TEST(PostMutation, every_changed_token_is_seen) {
  const char* asked = std::getenv("POST_MUTATION_PROGRAMS");
  const int programs = asked ? std::atoi(asked) : 2;
  const PostContext context = post_context();
  for (const Post& post : posts()) {
    const Tolerance tolerance = tolerance_of(post, context);
    int mutants = 0, refused = 0, different = 0, linted = 0, unexplained = 0;
    std::map<std::string, int> reasons;
    for (int seed = 1; seed <= programs; ++seed) {
      const Program p = random_program(1000 + seed, {.sections = 1, .points = 6});
      const auto text = post.write(p, context);
      ASSERT_TRUE(text) << text_of(text.error());
      Random random = Random::stream(seed, "mutation");
      for (const Token& t : tokens_of(*text)) {
        const std::string token = text->files[t.file].bytes.substr(t.begin, t.end - t.begin);
        std::vector<std::string> changes = {"", token + " " + token};
        std::string digit = token;  // one digit becomes another
        std::vector<std::size_t> digits;
        for (std::size_t i = 0; i < digit.size(); ++i)
          if (digit[i] >= '0' && digit[i] <= '9') digits.push_back(i);
        if (!digits.empty()) {
          char& c = digit[digits[random.below(digits.size())]];
          c = static_cast<char>('0' + (c - '0' + 1 + random.below(9)) % 10);
          changes.push_back(digit);
        }
        if (token[0] == '-') changes.push_back(token.substr(1));
        if (token[0] >= '0' && token[0] <= '9') changes.push_back("-" + token);
        if (digits.empty() && token != "\n") {
          std::string other = token;
          other[random.below(other.size())] = "AEIXZ79_=,+"[random.below(11)];
          if (other != token) changes.push_back(other);
        }
        for (const std::string& change : changes) {
          ProgramText mutant = *text;
          mutant.files[t.file].bytes.replace(t.begin, t.end - t.begin, change);
          ++mutants;
          const auto back = post.read(mutant, context);
          if (!back) {
            ++refused;
            continue;
          }
          if (!difference(p, *back, tolerance, post.language == Language::inform).empty()) {
            ++different;
            continue;
          }
          bool is_linted = false;
          for (const Check& c : post.lint(mutant, context)) is_linted |= !c.is_passed;
          if (is_linted) {
            ++linted;
            continue;
          }
          const std::string before = line_around(text->files[t.file].bytes, t.begin), after = line_around(mutant.files[t.file].bytes, t.begin);
          const std::size_t angle = static_cast<std::size_t>(std::abs(static_cast<long>(token.size()) - static_cast<long>(change.size())));
          std::string why = harmless(post.language, before, token, change);
          if (why.empty() && angle == 0 && !digits.empty() && std::abs(std::atof(token.c_str() + (token[0] >= 'A' ? 1 : 0)) - std::atof(change.c_str() + (change[0] >= 'A' ? 1 : 0))) < 2.1e-4)
            why = "an angle changed by no more than its tolerance";
          if (!why.empty()) {
            ++reasons[why];
          } else if (++unexplained <= 20) {
            std::printf("%s not seen:\n  %s\n  %s\n", std::string(name_of(post.language)).c_str(), before.c_str(), after.c_str());
          }
        }
      }
    }
    const int harmless_count = mutants - refused - different - linted - unexplained;
    std::printf("%s: %d mutants of %d programs, refused %d, different %d, lint %d, harmless %d (%.2f %%), unexplained %d\n",
                std::string(name_of(post.language)).c_str(), mutants, programs, refused, different, linted, harmless_count, 100.0 * harmless_count / mutants, unexplained);
    for (const auto& [why, n] : reasons) std::printf("  %5d %s\n", n, why.c_str());
    EXPECT_EQ(unexplained, 0) << name_of(post.language);
  }
}

}  // namespace
}  // namespace asbuilt
