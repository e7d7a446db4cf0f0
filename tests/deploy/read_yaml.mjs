// Prints the YAML documents of standard input as a JSON array.
import fs from 'node:fs';
import YAML from 'yaml';

console.log(JSON.stringify(YAML.parseAllDocuments(fs.readFileSync(0, 'utf8')).map((document) => document.toJS())));
