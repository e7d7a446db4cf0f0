// Checks inventories with the schema of CycloneDX 1.5: check_inventory.mjs FILE ... Prints what is wrong, a JSON list for each.
import { readFileSync } from 'node:fs';
import { Spec, Validation } from '@cyclonedx/cyclonedx-library';

const validator = new Validation.JsonStrictValidator(Spec.Version.v1dot5);
for (const file of process.argv.slice(2)) {
  const faults = await validator.validate(readFileSync(file, 'utf8'));
  console.log(JSON.stringify(faults ?? []));
}
