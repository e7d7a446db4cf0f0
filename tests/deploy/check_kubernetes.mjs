// Checks the manifests of standard input, a JSON array, with the schemas of the Kubernetes API and of KEDA; prints a line for each
// fault.
// The validators of kubernetes-models check values and pass fields that they do not know; TypeScript refuses those.
import fs from 'node:fs';
import ts from 'typescript';

const manifests = JSON.parse(fs.readFileSync(0, 'utf8'));
const nameOf = (manifest) => `${manifest.kind} ${manifest.metadata?.name}`;
const moduleOf = ({apiVersion}) =>
  `${apiVersion.startsWith('keda.sh/') ? '@kubernetes-models/keda' : 'kubernetes-models'}/${apiVersion}`;

const known = [];
for (const manifest of manifests) {
  try {
    const {[manifest.kind]: Model} = await import(moduleOf(manifest));
    if (!Model) throw new Error(`${manifest.apiVersion} has no such kind`);
    known.push(manifest);
    new Model(manifest).validate();
  } catch (error) {
    console.log(`${nameOf(manifest)}: ${error.message}`);
  }
}

const file = 'manifests.mts';
const source = known.map((manifest, i) =>
  `import type {I${manifest.kind} as T${i}} from '${moduleOf(manifest)}';\n`
  + `export const m${i}: T${i} = ${JSON.stringify(manifest)};\n`).join('');
const options = {strict: true, noEmit: true, skipLibCheck: true, module: ts.ModuleKind.NodeNext,
  moduleResolution: ts.ModuleResolutionKind.NodeNext, target: ts.ScriptTarget.ES2022, types: []};
const host = ts.createCompilerHost(options);
const {readFile, fileExists} = host;
host.readFile = (name) => (name.endsWith(file) ? source : readFile(name));
host.fileExists = (name) => name.endsWith(file) || fileExists(name);
const {getSourceFile} = host;
host.getSourceFile = (name, ...rest) =>
  (name.endsWith(file) ? ts.createSourceFile(name, source, ts.ScriptTarget.ES2022) : getSourceFile(name, ...rest));
const program = ts.createProgram([file], options, host);
for (const found of ts.getPreEmitDiagnostics(program)) {
  const line = found.file?.fileName.endsWith(file) ? found.file.getLineAndCharacterOfPosition(found.start).line : -1;
  const where = line < 0 ? 'types' : nameOf(known[Math.floor(line / 2)]);
  console.log(`${where}: ${ts.flattenDiagnosticMessageText(found.messageText, ' ').slice(0, 300)}`);
}
