#include "tests/stability/columns.h"

#include <algorithm>

#include "filter/methods.h"

namespace lumifold::stability {
namespace {

Column FilterColumn(const std::string& method) {
  return {method, "", [method](const Subject& subject, TaskPool* pool) {
            return filter::FilterFilm(subject.film.pixels, method, pool, &subject.film.edges);
          }};
}

std::vector<Column> ListColumns() {
  std::vector<Column> columns;
  for (const filter::Method& method : filter::Methods()) columns.push_back(FilterColumn(method.name));
  return columns;
}

}  // namespace

const std::vector<Column>& AllColumns() {
  static const std::vector<Column> columns = ListColumns();
  return columns;
}

const Column* FindColumn(const std::string& name) {
  const std::vector<Column>& all = AllColumns();
  const auto found = std::find_if(all.begin(), all.end(), [&](const Column& c) { return c.name == name; });
  return found == all.end() ? nullptr : &*found;
}

}  // namespace lumifold::stability
