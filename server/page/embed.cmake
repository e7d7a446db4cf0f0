# Writes OUT, C++ with the bytes of FILES, which are in FOLDER, for web_files.h.
set(text "#include \"server/page/web_files.h\"\n\nnamespace lumifold::page {\nnamespace {\n\n")
set(table)
set(number 0)
foreach(name IN LISTS FILES)
  file(READ ${FOLDER}/${name} hex HEX)
  string(LENGTH "${hex}" digits)
  math(EXPR bytes "${digits} / 2")
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "\\\\x\\1" escaped "${hex}")
  # Short pieces: a literal has a longest length. "\x41" "42" keeps digits that follow apart.
  string(REGEX REPLACE "((\\\\x[0-9a-f][0-9a-f]){64})" "\\1\"\n    \"" pieces "${escaped}")
  string(APPEND text "constexpr char kFile${number}[] =\n    \"${pieces}\";\n")
  string(APPEND table "      {\"${name}\", {kFile${number}, ${bytes}}},\n")
  math(EXPR number "${number} + 1")
endforeach()
string(APPEND text "\n}  // namespace\n\nconst std::vector<WebFile>& WebFiles() {\n"
       "  static const auto& files = *new std::vector<WebFile>{\n${table}  };\n  return files;\n}\n\n"
       "}  // namespace lumifold::page\n")
file(WRITE ${OUT} "${text}")
